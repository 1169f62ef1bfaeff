"""Folders of small images of any kind: colour, grey, 16-bit depth, masks."""

from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

SIZE = (48, 64)  # rows, columns


def picture(kind: str, seed: int = 0, size: tuple[int, int] = SIZE) -> np.ndarray:
    grey = texture(*size, seed)
    if kind == "colour":
        return np.dstack([grey, grey[::-1], grey[:, ::-1]])
    if kind == "depth":
        return grey.astype(np.uint16) * 12 + 500
    if kind == "mask":
        return np.where(grey > 128, 255, 0).astype(np.uint8)
    return grey


def write_images(place: Path, name: str, kind: str, numbers=range(6), size: tuple[int, int] = SIZE) -> Path:
    """Images named by ``name``, such as "frame-{:06d}.color.png"; returns the folder."""
    place.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        assert cv2.imwrite(str(place / name.format(number)), picture(kind, int(number) % 100, size))
    return place
