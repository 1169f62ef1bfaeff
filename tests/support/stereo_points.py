"""Points with true matches in two frames of the boards, by a stereo camera and by depth maps."""

import cv2
import numpy as np
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import keypoints

from sips_lit.geometry.projection import sample_depth, transfer
from sips_lit.types import Keypoints, Matches

SCENES = {tells: StereoScene(3, tells) for tells in ("stereo", "depth")}


def true_points(seed: int = 0, wrong: float = 0.4) -> tuple[Keypoints, Keypoints, Matches, np.ndarray]:
    """Points that both frames 0 and 2 show, in a random order, a part of them matched wrongly; which are right."""
    scene, generator = SCENES["depth"], np.random.default_rng(seed)
    xy = cv2.goodFeaturesToTrack(scene.frames[0], 150, 1e-3, 6).reshape(-1, 2)
    depth = sample_depth(scene.depths[0], xy)
    T_1_0 = np.linalg.inv(scene.poses[2]) @ scene.poses[0]
    moved, depth_there = transfer(xy, depth, CAMERA, CAMERA, T_1_0)
    inside = ((moved > 5) & (moved < np.array(CAMERA.size) - 6)).all(1)
    seen = inside & np.isclose(sample_depth(scene.depths[2], moved), depth_there, rtol=0.02)
    xy, moved = xy[seen], moved[seen]
    right = generator.random(len(xy)) >= wrong
    moved[~right] = generator.uniform([5, 5], np.array(CAMERA.size) - 6, (int((~right).sum()), 2))
    order = generator.permutation(len(xy))
    shuffled = np.empty_like(moved)
    shuffled[order] = moved
    return keypoints(xy), keypoints(shuffled), Matches(np.arange(len(xy)), order), right
