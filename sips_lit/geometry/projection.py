"""Points of one view in another: their depth, and where a camera or the homography of a plane puts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def sample_depth(depth: FloatArray, xy: FloatArray) -> NDArray[np.float64]:
    """Depth (N,) of the pixel nearest to each point (N, 2); NaN outside the map (H, W) and where it is not positive.

    Nearest, not interpolated: a mean of foreground and background lies on neither.
    """
    column, row = np.round(np.asarray(xy, np.float64)).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < depth.shape[1]) & (row < depth.shape[0])
    sampled = np.full(len(column), np.nan)
    sampled[inside] = depth[row[inside], column[inside]]
    with np.errstate(invalid="ignore"):
        sampled[~(sampled > 0) | ~np.isfinite(sampled)] = np.nan
    return sampled


def back_project(xy: FloatArray, depth: FloatArray, camera: Camera) -> NDArray[np.float64]:
    """Points (N, 3) in the camera's frame that are seen at N pixels (N, 2) with depths (N,); NaN where it is NaN."""
    homogeneous = np.column_stack([xy, np.ones(len(xy))]).astype(np.float64)
    points: NDArray[np.float64] = (np.linalg.solve(camera.matrix, homogeneous.T) * depth).T
    return points


def project(points: FloatArray, camera: Camera) -> NDArray[np.float64]:
    """Pixels (N, 2) of points (N, 3) in the camera's frame; NaN where they are not in front of it."""
    projected = np.asarray(points @ camera.matrix.T, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(points[:, 2:] > 0, projected[:, :2] / projected[:, 2:], np.nan)


def inside(xy: FloatArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which of N pixels (N, 2) are in an image of ``size`` (W, H), whose pixels reach from -0.5 to W - 0.5; not NaN ones."""
    with np.errstate(invalid="ignore"):
        within: NDArray[np.bool_] = np.all((xy >= -0.5) & (xy <= np.array(size) - 0.5), axis=1)
    return within


def transfer(
    xy: FloatArray, depth: FloatArray, camera_from: Camera, camera_to: Camera, T_to_from: FloatArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) and depths (N,) in the other view of N pixels (N, 2) with depths (N,); NaN where behind the camera."""
    points = back_project(xy, depth, camera_from) @ T_to_from[:3, :3].T + T_to_from[:3, 3]
    return project(points, camera_to), np.where(points[:, 2] > 0, points[:, 2], np.nan)


def apply_homography(H: FloatArray, xy: FloatArray) -> NDArray[np.float64]:
    """Points (N, 2) mapped by a homography (3, 3); NaN where a point goes behind the other camera.

    H preserves orientation, as between two photographs of the same side of a plane: its sign is then that of its
    determinant, and a point is in front of the camera where the third coordinate has the same sign.
    """
    mapped = np.column_stack([xy, np.ones(len(xy))]).astype(np.float64) @ np.asarray(H, np.float64).T
    in_front = mapped[:, 2:] * np.sign(np.linalg.det(H)) > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(in_front, mapped[:, :2] / mapped[:, 2:], np.nan)
