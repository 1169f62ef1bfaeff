"""A detector that knows where its points are in every frame, and is wrong about some of them on purpose."""

import numpy as np

from sips_lit.detect.base import BaseDetector
from sips_lit.types import Features, GreyImage, Keypoints

WRONG = 7.0  # pixels aside of another point in x and in y: further than any threshold from all


class Oracle(BaseDetector):
    """Points ``where[frame]`` (N, 2), best first; those that ``wrong(frame, number)`` marks (N,) are elsewhere.

    A frame that is not in ``where`` has no points. Each point describes itself by its number, so matches are known.
    """

    name, describes = "oracle", True

    def __init__(self, sequence, where, wrong) -> None:
        self.frame_of = {sequence.frame(index).tobytes(): index for index in range(len(sequence))}
        self.where, self.wrong = where, wrong

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        return self.detect_and_describe(image, n).keypoints

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        frame = self.frame_of[np.ascontiguousarray(image).tobytes()]
        if frame not in self.where:
            return Features(Keypoints.empty(), np.zeros((0, 64), np.float32), "l2")
        xy = np.array(self.where[frame], np.float32)
        count, number = len(xy), np.arange(len(xy))
        elsewhere = xy[(11 * number + 3) % count] + WRONG
        xy[self.wrong(frame, number)] = elsewhere[self.wrong(frame, number)]
        points = Keypoints(xy, (1 - number / count).astype(np.float32), np.ones(count, np.float32))
        return Features(points, np.eye(count, 64, dtype=np.float32), "l2").best(n)
