"""Inliers by a known homography (planar scenes: HPatches, simulated flights)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import apply_homography, inside
from sips_lit.inliers.independent import IndependentCheck
from sips_lit.types import FramePair, Inliers, Keypoints, Matches, Reason


@dataclass(frozen=True, slots=True)
class HomographyInliers(IndependentCheck):
    """A match is an inlier if its points agree within ``threshold`` pixels when mapped either way.

    The threshold grows with the scale of the point that is compared against, as localisation does.
    """

    threshold: float = 3.0

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {"inliers": "homography", "threshold": self.threshold}

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Raises BadInputError for a pair without a homography."""
        if pair.homography is None:
            raise BadInputError(f"{pair.name} has no homography: choose another source of inliers, such as inliers=klt")
        points0, points1 = keypoints0.xy[matches.index0], keypoints1.xy[matches.index1]
        in1 = apply_homography(pair.homography, points0)
        in0 = apply_homography(np.linalg.inv(pair.homography), points1)
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(in1 - points1, axis=1) <= self.threshold * keypoints1.scale[matches.index1]
            near &= np.linalg.norm(in0 - points0, axis=1) <= self.threshold * keypoints0.scale[matches.index0]
        height, width = pair.image1.shape
        visible = inside(in1, (width, height))
        reason = np.where(near, Reason.INLIER, np.where(visible, Reason.FAR, Reason.LOST)).astype(np.uint8)
        known = (np.ones(len(keypoints0), np.bool_), np.ones(len(keypoints1), np.bool_))
        return Inliers(near, reason, *known)
