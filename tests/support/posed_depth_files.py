"""A tiny folder of images with poses and sparse depth."""

from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

POSES = ["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 0.5 0 1 0 0 0 0 1 1", "1 0 0 1 0 1 0 0 0 0 1 2"]


def depth_of(index: int) -> np.ndarray:
    depth = np.full((48, 64), 10.0 + index, np.float16)
    depth[::2] = 0
    return depth


def make_posed_depth(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(3):
        assert cv2.imwrite(str(folder / f"{i:010d}.png"), texture(48, 64, i))
    (folder / "poses.txt").write_text("\n".join(POSES) + "\n")
    (folder / "cam.txt").write_text("50 0 31.5\n0 50 23.5\n0 0 1\n")
    np.savez(folder / "depth_48x64.npz", **{f"{i:010d}": depth_of(i) for i in range(3)})
    return folder
