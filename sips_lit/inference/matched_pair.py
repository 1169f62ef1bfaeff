"""What matching two images gives: the matches, how sure they are, the model that explains them, and a picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.frames.images import shrunk_size
from sips_lit.geometry.pose import rotation_error
from sips_lit.geometry.two_view import FEWEST_FOR_HOMOGRAPHY, FEWEST_FOR_POSE
from sips_lit.render.canvas import Picture
from sips_lit.render.matches import draw_matches
from sips_lit.types import GreyImage, Inliers, Keypoints, Matches, Reason

FEW_INLIERS: Final = 10
"""The k of the paper: a model with fewer inliers may be chance."""
SHOWN_WIDTH: Final = 1200
"""Pixels of a window or a page that shows the picture."""


@dataclass(frozen=True, slots=True)
class MatchedPair:
    """Two images with their points, ``keypoints0`` and ``keypoints1``, and M matches between them.

    ``confidence`` (M,) float32 from 0 to 1: the probability of being an inlier (`shared_probability`) where the detector's
    scores are probabilities, else an order (`distinctness`). ``inlier`` (M,) bool: what agrees with the model, which is
    ``homography`` (3, 3), pixels of image 0 to image 1, or, of known cameras, ``T_1_0`` (4, 4), points of camera 0 to
    camera 1 with a translation of length 1 (0 where only a rotation is seen: `fit_relative_pose`). None where there is none.
    """

    image0: GreyImage
    image1: GreyImage
    keypoints0: Keypoints
    keypoints1: Keypoints
    matches: Matches
    confidence: NDArray[np.float32]
    inlier: NDArray[np.bool_]
    posed: bool
    homography: NDArray[np.float64] | None
    T_1_0: NDArray[np.float64] | None

    def __len__(self) -> int:
        return len(self.matches)

    @property
    def xy0(self) -> NDArray[np.float32]:
        """Matched points (M, 2) of image 0 in pixels; (0, 0) is the centre of the top-left one."""
        return self.keypoints0.xy[self.matches.index0]

    @property
    def xy1(self) -> NDArray[np.float32]:
        """Their partners (M, 2) in image 1."""
        return self.keypoints1.xy[self.matches.index1]

    @property
    def R(self) -> NDArray[np.float64] | None:  # noqa: N802 the field's name
        """The rotation (3, 3) of the relative pose."""
        return None if self.T_1_0 is None else self.T_1_0[:3, :3]

    @property
    def t(self) -> NDArray[np.float64] | None:
        """The translation (3,) of the relative pose, of length 1 or 0: points of camera 0 are at R X + t in camera 1."""
        return None if self.T_1_0 is None else self.T_1_0[:3, 3]

    @property
    def model(self) -> str:
        """The model in words, and where there is none, or only few matches agree, that."""
        kind, least = ("pose", FEWEST_FOR_POSE) if self.posed else ("homography", FEWEST_FOR_HOMOGRAPHY)
        if self.homography is None and self.T_1_0 is None:
            few = f"{len(self)} of {least} matches that it needs" if len(self) < least else "the matches do not agree"
            return f"no {kind}: {few}"
        doubt = " (few inliers: may be chance)" if self.inlier.sum() < FEW_INLIERS else ""
        if self.T_1_0 is None:
            return f"homography{doubt}"
        t = self.T_1_0[:3, 3]
        told = "t = " + " ".join(f"{value:.2f}" for value in t) if t.any() else "no translation seen"
        return f"pose: {rotation_error(self.T_1_0, np.eye(4)):.2f} degrees, {told}{doubt}"

    def picture(self, max_side: int | None = 1200, name: str = "") -> Picture:
        """Both images side by side, their points, and lines that join the inliers: RGB uint8 (H, W, 3).

        Images whose longer side exceeds ``max_side`` pixels are shrunk for it; None: as they are. ``name``: for the caption.
        """
        modelled = self.homography is not None or self.T_1_0 is not None
        other = Reason.FAR if modelled else Reason.UNKNOWN
        reason = np.where(self.inlier, Reason.INLIER, other).astype(np.uint8)
        (image0, points0), (image1, points1) = (
            _shrunk(image, points, max_side)
            for image, points in ((self.image0, self.keypoints0), (self.image1, self.keypoints1))
        )
        known0, known1 = np.ones(len(points0), np.bool_), np.ones(len(points1), np.bool_)
        inliers = Inliers(self.inlier, reason, known0, known1)
        return draw_matches(image0, image1, points0, points1, self.matches, inliers, None, None, name, SHOWN_WIDTH)


def _shrunk(image: GreyImage, keypoints: Keypoints, max_side: int | None) -> tuple[GreyImage, Keypoints]:
    height, width = image.shape
    size = shrunk_size((width, height), max_side)
    if size == (width, height):
        return image, keypoints
    xy = (keypoints.xy + 0.5) * (np.array(size) / (width, height)) - 0.5
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return small, replace(keypoints, xy=xy.astype(np.float32), covariance=None)
