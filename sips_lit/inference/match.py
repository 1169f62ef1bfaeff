"""Matching for people: two images in, matches with a homography or a relative pose out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector, as_grey
from sips_lit.detect.released import DEFAULT
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract
from sips_lit.geometry.two_view import HOMOGRAPHY_THRESHOLD, POSE_THRESHOLD, fit_homography, fit_relative_pose
from sips_lit.inference.intrinsics import Intrinsics, both_cameras
from sips_lit.inference.matched_pair import MatchedPair
from sips_lit.matching.confidence import distinctness, shared_probability
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.types import ColorOrder, Descriptor, Detector, Features, GreyImage


def match(
    image0: Any,
    image1: Any,
    n: int = 500,
    detector: Detector | str | Path = DEFAULT,
    descriptor: Descriptor | None = None,
    camera: Intrinsics | Sequence[Intrinsics] | None = None,
    color: ColorOrder = "rgb",
    threshold: float | None = None,
) -> MatchedPair:
    """Matches two images by mutual nearest neighbours, and fits a homography or, with a ``camera``, a relative pose.

    >>> pair = match("a.jpg", "b.jpg")
    >>> pair.xy0.shape == pair.xy1.shape == (len(pair), 2)
    True

    ``image0``, ``image1``: paths, arrays, PIL images or tensors; ``color`` is the order of the channels of arrays and
    tensors ("bgr" for what `cv2.imread` gives), as for `SipsDetector`. ``n``: points per image, at most. ``detector``: a
    checkpoint, the name of released weights, or any detector. ``descriptor``: by default the detector's own, or `RootSift`
    where it has none. ``camera``: a `Camera` or its matrix (3, 3) in pixels, of both images, or a list of two; without lens
    distortion. ``threshold``: pixels within which inliers agree with the model, by default 3 (homography)
    or 1 (pose). The same input gives the same result.

    Raises BadInputError for images and numbers that are none of these, and for cameras that can't be those of the images.
    """
    chosen = SipsDetector.from_checkpoint(detector) if isinstance(detector, str | Path) else detector
    described = RootSift() if descriptor is None and not chosen.describes else descriptor
    matcher = PairMatcher(chosen, described, n, threshold)
    views = [matcher.view(as_grey(image, f"image {i}", color)) for i, image in enumerate((image0, image1))]
    return matcher.join(views[0], views[1], camera)


@dataclass(frozen=True, slots=True)
class View:
    """An image with its features."""

    image: GreyImage
    features: Features


@dataclass(frozen=True, slots=True)
class PairMatcher:
    """`match` in two steps, so that an image of several pairs is looked at once; ``descriptor`` None: the detector's own.

    Raises BadInputError for numbers that are out of range.
    """

    detector: Detector
    descriptor: Descriptor | None = field(default_factory=RootSift)
    n: int = 500
    threshold: float | None = None

    def __post_init__(self) -> None:
        if self.n < 0:
            raise BadInputError(f"n is {self.n}: ask for a number of points that is not negative")
        if self.threshold is not None and not (self.threshold > 0 and np.isfinite(self.threshold)):
            raise BadInputError(f"threshold is {self.threshold}: give pixels, more than 0")

    def view(self, image: GreyImage) -> View:
        """The features of a grey image (H, W)."""
        return View(image, extract(self.detector, self.descriptor, image, self.n).features)

    def join(self, view0: View, view1: View, camera: Intrinsics | Sequence[Intrinsics] | None = None) -> MatchedPair:
        """Matches two images and fits the model, as `match` says."""
        features = view0.features, view1.features
        points = features[0].keypoints, features[1].keypoints
        cameras = None if camera is None else both_cameras(camera, view0.image.shape, view1.image.shape)
        apart = distances(*features)
        matches = mutual_nearest(apart)
        kept = points[0][matches.index0], points[1][matches.index1]
        probable = self.detector.scores == "probability"
        confidence = shared_probability(kept[0].score, kept[1].score) if probable else distinctness(apart, matches)
        H, T_1_0 = None, None
        if cameras is None:
            plane = fit_homography(kept[0].xy, kept[1].xy, self.threshold or HOMOGRAPHY_THRESHOLD)
            H, inlier = plane.H, plane.inlier
        else:
            motion = fit_relative_pose(kept[0].xy, kept[1].xy, *cameras, self.threshold or POSE_THRESHOLD)
            T_1_0, inlier = motion.T_1_0, motion.inlier
        sides = view0.image, view1.image, *points
        return MatchedPair(*sides, matches, confidence, inlier, cameras is not None, H, T_1_0)
