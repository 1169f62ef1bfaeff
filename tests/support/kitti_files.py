"""Tiny sequences in the published layout of KITTI odometry."""

from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

K = np.array([[100.0, 0, 31.25], [0, 100.0, 22.5], [0, 0, 1]])
OFFSETS = {0: (0, 0, 0), 1: (-0.5, 0, 0), 2: (0.06, -0.001, 0.003), 3: (-0.47, -0.001, 0.003)}  # KITTI's, rounded


def projection(camera: int) -> np.ndarray:
    return K @ np.column_stack([np.eye(3), OFFSETS[camera]])


def pose(index: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.01, 0.05, -0.02]) * index)[0]
    T[:3, 3] = np.array([0.1, -0.02, 0.9]) * index
    return T


def make_kitti(root: Path, names: tuple[str, ...] = ("00",), cameras=(0, 1, 2, 3), frames: int = 4) -> Path:
    """The published layout under root/dataset."""
    dataset = root / "dataset"
    (dataset / "poses").mkdir(parents=True)
    for name in names:
        folder = dataset / "sequences" / name
        for camera in cameras:
            (folder / f"image_{camera}").mkdir(parents=True)
            for i in range(frames):
                grey = texture(48, 64, 10 * camera + i)
                image = grey if camera < 2 else np.stack([grey, grey // 2, grey // 3], 2)
                assert cv2.imwrite(str(folder / f"image_{camera}" / f"{i:06d}.png"), image)
        lines = [f"P{c}: " + " ".join(f"{v:.12e}" for v in projection(c).ravel()) for c in range(4)]
        tr = "Tr: " + " ".join(["1"] * 12)
        (folder / "calib.txt").write_text("\n".join([*lines, tr, ""]))
        (folder / "times.txt").write_text("".join(f"{0.1 * i:.6e}\n" for i in range(frames)))
        rows = [" ".join(f"{v:.12e}" for v in pose(i)[:3].ravel()) for i in range(frames)]
        (dataset / "poses" / f"{name}.txt").write_text("\n".join(rows) + "\n")
    return dataset
