"""Sequences in the layout of TUM mono, written for the tests."""

import zipfile
from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

SIZE = (160, 128)  # W, H
NARROW = "0.535719308086809 0.669566858850269 0.493248545285398 0.500408664348414 0.897966326944875"
WIDE = "0.349153000000000 0.436593000000000 0.493140000000000 0.499021000000000 0.933592000000000"
RESPONSE = 255 * (np.arange(256) / 255) ** 2.2  # of a camera with a gamma


def vignette() -> np.ndarray:
    """(H, W) up to 1, darker towards the corners."""
    x, y = np.meshgrid(np.linspace(-1, 1, SIZE[0]), np.linspace(-1, 1, SIZE[1]))
    fall = 1 / (1 + 0.4 * (x**2 + y**2))
    return fall / fall.max()


def write_sequence(
    folder: Path,
    count: int = 4,
    zipped: bool = True,
    camera: str = f"{NARROW}\n160 128\ncrop\n80 60\n",
    images: list[np.ndarray] | None = None,
) -> Path:
    """``count`` JPEG images of texture, or PNG of the given ``images``."""
    folder.mkdir(parents=True, exist_ok=True)
    suffix = "jpg" if images is None else "png"
    images = [texture(SIZE[1], SIZE[0], i) for i in range(count)] if images is None else images
    coded = {f"{i:05d}.{suffix}": cv2.imencode(f".{suffix}", image)[1].tobytes() for i, image in enumerate(images)}
    if zipped:
        with zipfile.ZipFile(folder / "images.zip", "w") as archive:
            for name, data in coded.items():
                archive.writestr(name, data)
    else:
        (folder / "images").mkdir()
        for name, data in coded.items():
            (folder / "images" / name).write_bytes(data)
    times = [f"{i:05d} {1464794230.5 + 0.05 * i:.7f} {1.25 + i:.4f}" for i in range(len(coded))]
    (folder / "times.txt").write_text("\n".join(times) + "\n")
    (folder / "camera.txt").write_text(camera)
    (folder / "pcalib.txt").write_text(" ".join(f"{value:.6f}" for value in RESPONSE) + " \n")
    cv2.imwrite(str(folder / "vignette.png"), np.round(vignette() * 65535).astype(np.uint16))
    return folder
