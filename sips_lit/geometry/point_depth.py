"""Depth of single points of an image: from its depth map or, where there is none, from its rectified stereo partner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.projection import inside, sample_depth, transfer
from sips_lit.types import Camera, DisparityMatcher, FloatArray, FramePair, GreyImage, ImageSequence, Keypoints


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

    def depth_at(self, xy: FloatArray, stereo: DisparityMatcher) -> NDArray[np.float64]:
        """Depth along the optical axis (N,) in metres of N points (N, 2); NaN where it is not known."""
        if self.depth is not None:
            return sample_depth(self.depth, xy)
        if self.right is None or not self.baseline:
            return np.full(len(xy), np.nan)
        disparity = stereo.disparity(self.image, self.right, xy, to_the_right=self.baseline > 0)
        return abs(self.baseline) * float(self.camera.matrix[0, 0]) / disparity

    def depth_of(self, keypoints: Keypoints, stereo: DisparityMatcher) -> NDArray[np.float64]:
        """The depth (N,) that keypoints of this image bring, or else what the view tells."""
        return self.depth_at(keypoints.xy, stereo) if keypoints.depth is None else keypoints.depth

    @property
    def tells_depth(self) -> bool:
        """Whether the depth of any point may be known: a map may hold nothing."""
        if self.depth is not None:
            return bool((np.isfinite(self.depth) & (self.depth > 0)).any())
        return self.has_depth


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


def posed_views(pair: FramePair) -> tuple[View, View, FloatArray] | None:
    """Both images and the ``T_1_0`` of a pair; None where its cameras, its pose or the depth of every point is not known."""
    both, T_1_0 = views(pair), None if pair.geometry is None else pair.geometry.T_1_0
    if both is None or T_1_0 is None or not (both[0].has_depth or both[1].has_depth):
        return None
    return *both, T_1_0


def transfer_to_view(
    xy: FloatArray, depth: FloatArray, here: View, there: View, T_there_here: FloatArray, occlusion: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Where N pixels (N, 2) with depths (N,) of one view are in the other (N, 2), NaN where unknown, and which it sees (N,).

    A point is hidden where the depth map of the other view, if any, is nearer by more than ``occlusion`` (relative).
    """
    moved, distance = transfer(xy, depth, here.camera, there.camera, T_there_here)
    visible = inside(moved, there.camera.size)
    if there.depth is not None:
        surface = sample_depth(there.depth, np.where(np.isfinite(moved), moved, -10))
        with np.errstate(invalid="ignore"):
            visible &= ~np.asarray(surface < distance * (1 - occlusion))
    return moved, visible


def frame_view(sequence: ImageSequence, index: int) -> View | None:
    """Frame ``index`` of a sequence with what tells depth in it: its depth map, else its stereo partner.

    None where its camera is not known. Raises BadInputError when the frame or its depth cannot be read.
    """
    camera = sequence.camera(index)
    if camera is None:
        return None
    depth = sequence.depth(index)
    right = sequence.right(index) if depth is None else None
    return View(sequence.frame(index), camera, depth, right, sequence.baseline() if right is not None else None)
