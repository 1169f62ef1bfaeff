"""Depth of single points of an image: from its depth map or, where there is none, from its rectified stereo partner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.projection import sample_depth
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.types import Camera, FloatArray, FramePair, GreyImage


@dataclass(frozen=True, slots=True)
class View:
    """One image (H, W) of a pair with its camera and whatever tells depth in it: see `ViewGeometry`."""

    image: GreyImage
    camera: Camera
    depth: FloatArray | None
    right: GreyImage | None
    baseline: float | None

    @property
    def has_depth(self) -> bool:
        """Whether anything tells depth."""
        return self.depth is not None or (self.right is not None and bool(self.baseline))

    def depth_at(self, xy: FloatArray, stereo: StereoMatcher) -> NDArray[np.float64]:
        """Depth along the optical axis (N,) in metres of N points (N, 2); NaN where it is not known."""
        if self.depth is not None:
            return sample_depth(self.depth, xy)
        if self.right is None or not self.baseline:
            return np.full(len(xy), np.nan)
        disparity = stereo.disparity(self.image, self.right, xy, to_the_right=self.baseline > 0)
        return abs(self.baseline) * float(self.camera.matrix[0, 0]) / disparity


def views(pair: FramePair) -> tuple[View, View] | None:
    """Both images of a pair with what tells depth in them; None where its cameras are not known."""
    g = pair.geometry
    if g is None:
        return None
    # the clean frames, not the photometrically changed images: the right images are clean, too
    return (
        View(pair.frames[0], g.camera0, g.depth0, g.right0, g.baseline),
        View(pair.frames[-1], g.camera1, g.depth1, g.right1, g.baseline),
    )
