"""Points in space seen by a moving camera, without images: every place is known, and each point describes itself."""

import cv2
import numpy as np

from sips_lit.odometry.odometer import FramePoints
from sips_lit.types import Camera, Features, Keypoints

CAMERA = Camera(np.array([[400.0, 0, 320], [0, 420.0, 240], [0, 0, 1]]), (640, 480))


def pose(index: int) -> np.ndarray:
    """T_world_camera: the same motion each frame, a turn and a shift."""
    step = np.eye(4)
    step[:3, :3] = cv2.Rodrigues(np.array([0.004, -0.01, 0.003]))[0]
    step[:3, 3] = 0.03, -0.01, 0.1
    return np.linalg.matrix_power(step, index)


def world(count: int = 80, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-4, -3, 4], [4, 3, 9], (count, 3))


def seen(index: int, points: np.ndarray, noise: float = 0.0, wrong: float = 0.0, depth: bool = True) -> FramePoints:
    """Those of the points (N, 3) that frame ``index`` sees; a share is ``wrong``: elsewhere in the image."""
    generator = np.random.default_rng([index, 7])
    there = points @ np.linalg.inv(pose(index))[:3, :3].T + np.linalg.inv(pose(index))[:3, 3]
    xy = there @ CAMERA.matrix.T
    xy = xy[:, :2] / xy[:, 2:] + generator.normal(0, 1, (len(points), 2)) * noise
    bad = generator.random(len(points)) < wrong
    xy[bad] = generator.uniform([0, 0], CAMERA.size, (int(bad.sum()), 2))
    inside = (there[:, 2] > 0.5) & ((xy >= 0) & (xy < CAMERA.size)).all(1)
    number, ones = np.flatnonzero(inside), np.ones(int(inside.sum()), np.float32)
    known = there[number, 2] if depth else None
    keypoints = Keypoints(xy[number].astype(np.float32), ones, ones, known)
    descriptors = np.eye(len(points), dtype=np.float32)[number]
    return FramePoints.of(Features(keypoints, descriptors, "l2"), CAMERA)


def only(frame: FramePoints, numbers: object) -> FramePoints:
    """What is left of a frame when it sees but the points of these numbers."""
    keep = np.isin(frame.features.descriptors.argmax(1), list(numbers))
    return FramePoints(frame.features[keep], frame.points[keep], frame.camera)
