"""Runs in the layout of Oxford RobotCar, written for the tests."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

DATE = "2014-07-14-14-49-50"
START = 1405345790123456  # microseconds
STEP = 62_500


def colour_image(seed: int = 0, size: tuple[int, int] = (96, 128)) -> np.ndarray:
    """(H, W, 3) BGR, smooth, and of quite different channels."""
    blue, green, red = (texture(*size, 10 * seed + channel).astype(float) for channel in range(3))
    image = np.dstack([0.3 * blue, 0.4 * green + 60, 0.5 * red + 120])
    return cv2.GaussianBlur(image, (0, 0), 3).astype(np.uint8)


def mosaic(image: np.ndarray, pattern: str) -> np.ndarray:
    """(H, W): of each pixel only the channel of the filter before it; ``pattern`` is that of the first four pixels."""
    raw = np.zeros(image.shape[:2], np.uint8)
    for place, channel in enumerate(pattern):
        row, column = divmod(place, 2)
        raw[row::2, column::2] = image[row::2, column::2, "bgr".index(channel)]
    return raw


def write_run(
    root: Path,
    listed: int = 5,
    there: Sequence[int] | None = None,
    camera: str = "stereo/centre",
    date: str = DATE,
    times: Sequence[int] | None = None,
) -> Path:
    """A run whose timestamps list some images, of which those of ``there`` (all, by default) exist."""
    folder = root / date
    (folder / camera).mkdir(parents=True)
    times = [START + STEP * i for i in range(listed)] if times is None else list(times)
    rows = [f"{time} {1 + i // 4}" for i, time in enumerate(times)]
    (folder / f"{camera.split('/')[0]}.timestamps").write_text("\n".join(rows) + "\n")
    for i in range(len(times)) if there is None else there:
        raw = mosaic(colour_image(i), "gbrg" if camera.startswith("stereo") else "rggb")
        cv2.imwrite(str(folder / camera / f"{times[i]}.png"), raw)
    return folder
