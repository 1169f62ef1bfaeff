"""Images of any kind as 8-bit grey."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp"})
END_MARKERS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}


def read_grey(path: str | Path) -> GreyImage:
    """An image file, grey, colour, with alpha, 8- or 16-bit, as grey uint8 (H, W); 16 bits are scaled by their full range.

    Raises BadInputError when the file is missing, truncated or not an image. OpenCV would give half a picture for a
    truncated one, so the end marker is looked for where the format has one.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read the image {path}: {error.strerror}") from error
    marker = END_MARKERS.get(path.suffix.lower())
    if marker is not None and marker not in data[-1024:]:
        raise BadInputError(f"the image {path} is truncated or damaged: its end is missing; replace or remove it")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None:
        raise BadInputError(f"{path} is not an image that OpenCV can read, or is damaged: replace or remove it")
    return to_grey(image)


def to_grey(image: NDArray[Any]) -> GreyImage:
    """An image as OpenCV decodes it, (H, W) or (H, W, 1, 3 or 4) in BGR order, as grey uint8 (H, W); alpha is dropped."""
    if image.dtype == np.uint16:
        image = (image / 257 + 0.5).astype(np.uint8)
    elif image.dtype != np.uint8:
        image = np.clip(image * 255 + 0.5, 0, 255).astype(np.uint8)
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] == 1 else cv2.cvtColor(image[..., :3].copy(), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image, np.uint8)


def resize_max_side(image: GreyImage, max_side: int | None) -> GreyImage:
    """The image shrunk so that its longer side is at most ``max_side`` pixels; never enlarged."""
    height, width = image.shape
    if max_side is None or max(height, width) <= max_side:
        return image
    scale = max_side / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def list_images(folder: str | Path) -> list[Path]:
    """The image files of a folder in natural order (img2 before img10); hidden and other files are passed over."""
    files = [p for p in Path(folder).iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".")]
    return sorted((p for p in files if p.is_file()), key=lambda p: _natural(p.name))


def _natural(name: str) -> list[tuple[int, int, str]]:
    """A sort key in which runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts]
