"""Images of any kind as 8-bit grey."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage

# grey at the depth of the file; the orientation tag is ignored, so that points are in pixels of the stored image
DECODE_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


def read_grey(path: str | Path) -> GreyImage:
    """An image file, grey or colour, as grey uint8 (H, W); alpha is dropped and the orientation tag (EXIF) ignored.

    Other depths are scaled: 16-bit values by their full range, floating-point ones from [0, 1]. Raises BadInputError when
    the file is missing, truncated or not an image, or has values of another kind.
    """
    return decode_grey(_bytes(Path(path)), str(path))


def decode_grey(data: bytes, name: str) -> GreyImage:
    """The image of a file's bytes as `read_grey` gives it; errors call it ``name``."""
    return _to_8_bits(_decode(data, name, DECODE_FLAGS), name)


def read_stored(path: Path) -> NDArray[Any]:
    """The values of an image file as they are stored, of any depth and number of channels.

    Raises BadInputError when the file is missing, truncated or not an image.
    """
    return _decode(_bytes(path), str(path), cv2.IMREAD_UNCHANGED)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read the image {path}: {error.strerror}") from error


def _decode(data: bytes, name: str, flags: int) -> NDArray[Any]:
    try:
        # from memory: given the name of a truncated file, OpenCV would return half a picture
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:  # such as more pixels than OpenCV allows
        image = None
    if image is None:
        raise BadInputError(
            f"{name} is not an image that OpenCV can read, or is truncated or damaged: replace or remove it"
        )
    return image


def _to_8_bits(image: NDArray[Any], name: str) -> GreyImage:
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    if image.dtype == np.uint16:
        return np.asarray(image / 257 + 0.5, np.uint8)
    if image.dtype.kind == "f" and np.all((image >= 0) & (image <= 1)):  # false for NaN
        return np.asarray(image * 255 + 0.5, np.uint8)
    raise BadInputError(
        f"{name} has values of type {image.dtype} from {image.min()} to {image.max()}: convert it to 8 or 16 bits, or to "
        "floating-point values in [0, 1]"
    )


def shrunk_size(size: tuple[int, int], max_side: int | None) -> tuple[int, int]:
    """The size (W, H) that `resize_max_side` gives an image of that size."""
    if max_side is None or max(size) <= max_side:
        return size
    scale = max_side / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def resize_max_side(image: GreyImage, max_side: int | None) -> GreyImage:
    """The image shrunk so that its longer side is at most ``max_side`` pixels; never enlarged."""
    before = (image.shape[1], image.shape[0])
    size = shrunk_size(before, max_side)
    return image if size == before else np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def check_max_side(max_side: int | None) -> None:
    """Raises BadInputError for a ``max_side`` (pixels) too small to be meant."""
    if max_side is not None and max_side < 16:
        raise BadInputError(f"data.max_side is {max_side}: it must be at least 16 pixels, or null to keep the size")
