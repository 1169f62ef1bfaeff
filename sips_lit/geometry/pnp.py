"""P3P in LO-RANSAC: the pose of a camera from points in space and their pixels, of which many are wrong (paper, pose).

PoseLib (https://github.com/PoseLib/PoseLib) does it: minimal samples, the score of MSAC, local optimisation of each new best
pose. It gives Python's lock back meanwhile: other threads run.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import poselib

from sips_lit.geometry.pose import PoseEstimate, on_a_line
from sips_lit.geometry.projection import project
from sips_lit.types import Camera, FloatArray

ESTIMATOR: Final = f"P3P in LO-RANSAC, PoseLib {poselib.__version__}"
"""For protocols."""
_UNIT_CAMERA: Final = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [1.0, 0.0, 0.0]}
_NO_FURTHER_REFINEMENT: Final = {"max_iterations": 0}  # PoseLib's last step has another loss: it loses inliers


def p3p_ransac(
    points: FloatArray,
    pixels: FloatArray,
    camera: Camera,
    generator: np.random.Generator,
    iterations: int = 3000,
    threshold: float = 3.0,
) -> PoseEstimate:
    """The best pose of exactly ``iterations`` random minimal samples, optimised locally, and the points that agree with it.

    ``points`` (M, 3) in frame 0, ``pixels`` (M, 2) in the ``camera`` of frame 1, all finite. The best pose has the smallest
    sum of squared reprojection errors, each cut off at ``threshold`` pixels (where the focal lengths of x and y differ, the
    search measures with their mean). An inlier is in front of the camera and projects within ``threshold``. A degenerate
    sample counts as an iteration. No pose without four correspondences, or without three inliers off a line.
    """
    count = len(points)
    none = PoseEstimate(None, np.zeros(count, np.bool_))
    if count < 4:
        return none
    X, xy = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    # PoseLib knows no skew, and searches on the plane at unit depth anyway
    plane = (np.column_stack([xy, np.ones(count)]) @ np.linalg.inv(camera.matrix).T)[:, :2]
    focal = (camera.matrix[0, 0] + camera.matrix[1, 1]) / 2
    options = {
        "min_iterations": iterations,
        "max_iterations": iterations,
        "max_reproj_error": threshold / focal,
        "seed": int(generator.integers(2**63)),
    }
    found, _ = poselib.estimate_absolute_pose(plane, X, _UNIT_CAMERA, options, _NO_FURTHER_REFINEMENT)
    pose = np.asarray(found.Rt, np.float64)
    errors = np.linalg.norm(project(X @ pose[:, :3].T + pose[:, 3], camera) - xy, axis=1)
    inlier = np.asarray(errors <= threshold, np.bool_)  # nothing agrees with a pose that is not finite
    if inlier.sum() < 3 or on_a_line(X[inlier]):
        return none
    return PoseEstimate(np.vstack([pose, [0, 0, 0, 1]]), inlier)
