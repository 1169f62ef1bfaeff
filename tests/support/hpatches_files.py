"""HPatches sequences in the published layout: views of one big texture by known homographies, of different sizes."""

from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

from sips_lit.geometry.projection import apply_homography

SIZES = [(160, 120), (120, 160), (140, 110), (160, 121), (90, 96), (160, 120)]


def from_plane(seed: int = 0, viewpoint: bool = True) -> list[np.ndarray]:
    """For each of six images (3, 3) the homography from the plane, 400 x 400, to its pixels."""
    generator = np.random.default_rng(seed)
    maps = []
    for i, (width, height) in enumerate(SIZES):
        turned = 0.25 * i if viewpoint else 0.0
        zoom = 0.75 * 1.1**i if viewpoint else 0.8
        c, s = zoom * np.cos(turned), zoom * np.sin(turned)
        A = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        A[:2, 2] = np.array([width, height]) / 2 - A[:2, :2] @ [200, 200]
        if viewpoint and i:
            A[2, :2] = generator.uniform(-1e-4, 1e-4, 2)
        maps.append(A)
    return maps


def write_sequence(
    root: Path, name: str = "v_made", seed: int = 0, viewpoint: bool = True, suffix: str = "ppm", enlarge: int = 1
) -> list[np.ndarray]:
    """Six images and five homographies; returns those from the plane. ``enlarge`` makes all of it so many times larger."""
    folder = root / name
    folder.mkdir(parents=True)
    plane = texture(400, 400, seed)
    maps = []
    for number, ((width, height), A) in enumerate(zip(SIZES, from_plane(seed, viewpoint), strict=True), start=1):
        E = np.diag([enlarge, enlarge, 1.0]) @ A
        image = cv2.warpPerspective(plane, E, (enlarge * width, enlarge * height), flags=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{number}.{suffix}"), cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        maps.append(E)
        if number > 1:
            np.savetxt(folder / f"H_1_{number}", E @ np.linalg.inv(maps[0]), fmt="%.12g")
    return maps


def photometric_error(image0: np.ndarray, image1: np.ndarray, H: np.ndarray) -> float:
    """Median difference in grey values of image 1 and image 0 brought into its place, where both see."""
    height, width = image1.shape
    x, y = np.meshgrid(np.arange(2, width - 2), np.arange(2, height - 2))
    back = apply_homography(np.linalg.inv(H), np.stack([x, y], -1).reshape(-1, 2).astype(float))
    inside = ((back >= 2) & (back <= np.array(image0.shape[::-1]) - 3)).all(1)
    assert inside.sum() > 100
    at = back.reshape(*x.shape, 2).astype(np.float32)
    seen = cv2.remap(image0, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(float)
    return float(np.median(np.abs(seen - image1[2:-2, 2:-2])[inside.reshape(x.shape)]))
