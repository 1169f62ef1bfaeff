"""What maps one image to another, from matches of which many are wrong: a homography, or the relative pose of two cameras.

Hartley and Zisserman, "Multiple View Geometry" (2nd edition): homographies (chapter 4), epipolar geometry (chapter 9). The
searches are those of libraries: MAGSAC++ of OpenCV's USAC, and the five-point method in LO-RANSAC of PoseLib.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import poselib
from numpy.typing import NDArray

from sips_lit.geometry.pose import PoseEstimate, on_a_line
from sips_lit.geometry.projection import apply_homography
from sips_lit.types import Camera, FloatArray

FEWEST_FOR_HOMOGRAPHY: Final = 4
FEWEST_FOR_POSE: Final = 5
HOMOGRAPHY_THRESHOLD: Final = 3.0
"""Pixels that an inlier may be off, as is usual: few scenes are truly planes."""
POSE_THRESHOLD: Final = 1.0
"""Pixels from an epipolar line. Wrong matches are seldom so near to one by chance; within 3 pixels many are (our choice, by
``benchmarks/pose_threshold.py``)."""
PARALLAX: Final = 1.0
"""Pixels by which matches have to move beyond a rotation before the direction of a translation is told (our choice)."""
FAR_SHARE: Final = 0.9
"""Of the inliers: where so many move by less, no translation is seen (our choice)."""
_UNIT_CAMERA: Final = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [1.0, 0.0, 0.0]}


@dataclass(frozen=True, slots=True)
class HomographyEstimate:
    """``H`` (3, 3) float64 from pixels of image 0 to image 1, or None, and which of the M matches agree, (M,) bool."""

    H: NDArray[np.float64] | None
    inlier: NDArray[np.bool_]


def fit_homography(
    xy0: FloatArray,
    xy1: FloatArray,
    threshold: float = HOMOGRAPHY_THRESHOLD,
    iterations: int = 2000,
    confidence: float = 0.995,
) -> HomographyEstimate:
    """The homography of M matches (M, 2), and those whose point of image 0 lands within ``threshold`` pixels of its partner.

    The same matches give the same homography: OpenCV's USAC has a seed of its own. None without four inliers off a line, and
    for a mirror image, which no camera takes of a plane.
    """
    count = len(xy0)
    none = HomographyEstimate(None, np.zeros(count, np.bool_))
    if count < FEWEST_FOR_HOMOGRAPHY:
        return none
    start, goal = np.ascontiguousarray(xy0, np.float64), np.ascontiguousarray(xy1, np.float64)
    found, _ = cv2.findHomography(start, goal, cv2.USAC_MAGSAC, threshold, maxIters=iterations, confidence=confidence)
    # OpenCV's types do not tell of None, which it gives where there is no homography
    H = None if found is None else np.asarray(found, np.float64)
    if H is None or not np.isfinite(H).all() or np.linalg.det(H) * H[2, 2] <= 0:
        return none
    with np.errstate(invalid="ignore"):
        inlier = np.asarray(np.linalg.norm(apply_homography(H, start) - goal, axis=1) <= threshold, np.bool_)
    if inlier.sum() < FEWEST_FOR_HOMOGRAPHY or on_a_line(start[inlier]) or on_a_line(goal[inlier]):
        return none
    return HomographyEstimate(H, inlier)


def fit_relative_pose(
    xy0: FloatArray,
    xy1: FloatArray,
    camera0: Camera,
    camera1: Camera,
    threshold: float = POSE_THRESHOLD,
    iterations: int = 3000,
) -> PoseEstimate:
    """``T_1_0`` of two cameras from M matches (M, 2), and those within ``threshold`` pixels of the epipolar lines.

    The distance is Sampson's. Two images do not tell how far a camera moved: the translation has length 1, or 0 where all
    that is seen is a rotation (`FAR_SHARE` of the inliers move by less than `PARALLAX` pixels beyond one). Points behind a
    camera are no inliers, except those that a rotation explains: they are so far that noise decides. The same matches give
    the same pose. None without five inliers off a line.
    """
    count = len(xy0)
    none = PoseEstimate(None, np.zeros(count, np.bool_))
    if count < FEWEST_FOR_POSE:
        return none
    planes = _on_unit_plane(xy0, camera0), _on_unit_plane(xy1, camera1)
    options = {
        "min_iterations": iterations,
        "max_iterations": iterations,
        "max_epipolar_error": threshold / np.mean([np.diag(camera.matrix)[:2].mean() for camera in (camera0, camera1)]),
        "seed": 0,
    }
    found, _ = poselib.estimate_relative_pose(planes[0][:, :2], planes[1][:, :2], _UNIT_CAMERA, _UNIT_CAMERA, options)
    pose = np.vstack([np.asarray(found.Rt, np.float64), [0, 0, 0, 1]])
    length = np.linalg.norm(pose[:3, 3])
    if not (np.isfinite(pose).all() and length > 0):
        return none
    pose[:3, 3] /= length
    near = epipolar_distance(xy0, xy1, camera0, camera1, pose) <= threshold
    far = _beyond_rotation(planes, pose[:3, :3], xy1, camera1) <= threshold
    inlier = np.asarray(near & (_in_front(planes, pose) | far), np.bool_)
    if inlier.sum() < FEWEST_FOR_POSE or on_a_line(np.asarray(xy0)[inlier]) or on_a_line(np.asarray(xy1)[inlier]):
        return none
    rays = planes[0][inlier], planes[1][inlier]
    R = _rotation(*rays)
    if np.mean(_beyond_rotation(rays, R, np.asarray(xy1)[inlier], camera1) < PARALLAX) >= FAR_SHARE:
        pose[:3, :3], pose[:3, 3] = R, 0
        inlier = inlier | (_beyond_rotation(planes, R, xy1, camera1) <= threshold)
    return PoseEstimate(pose, inlier)


def epipolar_distance(
    xy0: FloatArray, xy1: FloatArray, camera0: Camera, camera1: Camera, T_1_0: FloatArray
) -> NDArray[np.float64]:
    """Sampson's distance (M,) in pixels of M matches (M, 2) from the epipolar lines of a pose (chapter 11.4.3)."""
    x, y, z = np.asarray(T_1_0, np.float64)[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T_1_0[:3, :3]
    F = np.linalg.inv(camera1.matrix).T @ essential @ np.linalg.inv(camera0.matrix)
    start, goal = (np.column_stack([xy, np.ones(len(xy))]).astype(np.float64) for xy in (xy0, xy1))
    line1, line0 = start @ F.T, goal @ F
    gradient = np.sqrt((line0[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance: NDArray[np.float64] = np.abs((goal * line1).sum(1)) / gradient
    return distance


def _on_unit_plane(xy: FloatArray, camera: Camera) -> NDArray[np.float64]:
    """(M, 3) with z = 1: PoseLib knows no skew, and searches there anyway."""
    plane: NDArray[np.float64] = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(camera.matrix).T
    return plane


def _in_front(planes: tuple[FloatArray, FloatArray], pose: FloatArray) -> NDArray[np.bool_]:
    """Whether the points where the rays of M matches are nearest to each other are in front of both cameras."""
    here, there = (plane / np.linalg.norm(plane, axis=1, keepdims=True) for plane in planes)
    here, t = here @ pose[:3, :3].T, pose[:3, 3]
    cosine, along0, along1 = (here * there).sum(1), here @ t, there @ t
    return np.asarray((cosine * along1 > along0) & (along1 > cosine * along0), np.bool_)


def _beyond_rotation(
    planes: tuple[FloatArray, FloatArray], R: FloatArray, xy1: FloatArray, camera1: Camera
) -> NDArray[np.float64]:
    """Pixels (M,) from where a rotation alone puts the points of image 0 to their partners; infinite behind the camera."""
    seen = planes[0] @ R.T @ camera1.matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.linalg.norm(seen[:, :2] / seen[:, 2:] - xy1, axis=1)
    return np.where(seen[:, 2] > 0, distance, np.inf)


def _rotation(plane0: FloatArray, plane1: FloatArray) -> NDArray[np.float64]:
    """The rotation (3, 3) that turns rays of camera 0 into those of camera 1 best (Wahba's problem, by Kabsch's SVD)."""
    here, there = (plane / np.linalg.norm(plane, axis=1, keepdims=True) for plane in (plane0, plane1))
    U, _, Vt = np.linalg.svd(there.T @ here)
    R: NDArray[np.float64] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return R
