"""Images of any kind as 8-bit grey."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sips_lit.errors import BadInputError
from sips_lit.frames.span import Span, find_span
from sips_lit.types import GreyImage

GREY_VERSION = 2  # part of the fingerprints of sequences: frames change when the way to grey does
FEW_PIXELS = 2**25  # any file may claim so many
MOST_PIXELS_A_BYTE = 200  # a black JPEG has 64 to 90
PNG = b"\x89PNG\r\n\x1a\n"  # what such a file begins with
HEADERS = ("JPEG", "PNG", "TIFF", "BMP", "PPM", "WEBP", "JPEG2000")
warnings.filterwarnings("ignore", module=r"PIL\.")  # large photographs are welcome, and damage is told once
# channels and depth of the file, without alpha, turned upright by the orientation tag (EXIF) as videos are
DECODE_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


def read_grey(path: str | Path, span: Span | None = None) -> GreyImage:
    """An image file, grey or colour, as grey uint8 (H, W), upright by its orientation tag (EXIF); alpha is dropped.

    16-bit values are scaled by ``span``, by default the part of their range that this image uses; floating-point ones from
    [0, 1]. Raises BadInputError when the file is missing, truncated or not an image, or has values of another kind.
    """
    return to_grey(read_values(path), str(path), span)


def read_values(path: str | Path) -> NDArray[Any]:
    """The values of an image file, grey (H, W) or BGR (H, W, 3), of the depth that they are stored in.

    Raises BadInputError when the file is missing, truncated or not an image.
    """
    return decode_values(_bytes(Path(path)), str(path))


def read_rgb(path: str | Path, grey: GreyImage | None = None) -> NDArray[np.uint8]:
    """An image file as RGB uint8 (H, W, 3); of more than 8 bits it is ``grey``, by default that of `read_grey`.

    Raises BadInputError as `read_grey` does.
    """
    values = read_values(path)
    if values.dtype != np.uint8:
        return np.dstack([read_grey(path) if grey is None else grey] * 3)
    return np.asarray(cv2.cvtColor(values, cv2.COLOR_GRAY2RGB if values.ndim == 2 else cv2.COLOR_BGR2RGB), np.uint8)


def decode_values(data: bytes, name: str) -> NDArray[Any]:
    """The image of a file's bytes as `read_values` gives it; errors call it ``name``."""
    return _decode(data, name, DECODE_FLAGS)


def read_stored(path: Path) -> NDArray[Any]:
    """The values of an image file as they are stored, of any depth and number of channels.

    Raises BadInputError when the file is missing, truncated or not an image.
    """
    return _decode(_bytes(path), str(path), cv2.IMREAD_UNCHANGED)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # the latter for a NUL in the name
        raise BadInputError(f"cannot read the image {path}: {getattr(error, 'strerror', None) or error}") from error


def _decode(data: bytes, name: str, flags: int) -> NDArray[Any]:
    if data.startswith(PNG) and not _is_whole_png(data):
        data = b""  # OpenCV would allocate the gigabytes that a damaged length asks for
    pixels, mode = _header(data)
    if mode == "LAB":
        raise BadInputError(f"{name} has colours in LAB, which libraries convert differently: save it as RGB or grey")
    if pixels > max(FEW_PIXELS, MOST_PIXELS_A_BYTE * len(data)):
        raise BadInputError(f"{name} claims more pixels than its {len(data)} bytes can hold: replace it")
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


def _is_whole_png(data: bytes) -> bool:
    """Whether the chunks of a PNG file, as long as they say, lead to the last one."""
    at = len(PNG)
    while at + 8 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        at += 12 + length  # length, kind, content, checksum
        if kind == b"IEND":
            return at <= len(data)
    return False


def _header(data: bytes) -> tuple[int, str]:
    """How many pixels an image has by its header, and what Pillow calls its colours; 0 where Pillow can't tell.

    OpenCV would allocate them, and libjpeg fill them for a minute, however few there are in the file.
    """
    try:
        with Image.open(io.BytesIO(data), formats=HEADERS) as image:
            return image.width * image.height, image.mode
    except Image.DecompressionBombError:
        return 2**30, ""  # the most that OpenCV reads
    except Exception:  # damaged headers make Pillow raise almost anything
        return 0, ""


def to_grey(values: NDArray[Any], name: str, span: Span | None = None, rgb: bool = False) -> GreyImage:
    """Grey uint8 (H, W) of an image (H, W), (H, W, 1), or in colour (H, W, 3 or 4), alpha last: the one way to grey.

    Colour is BGR unless ``rgb``, and weighted as OpenCV does. Depths are treated as `read_grey` says, in any byte order.
    Raises BadInputError, which calls it ``name``, for another shape, an empty image and values of another kind.
    """
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (1, 3, 4)):
        raise BadInputError(f"{name} must be (H, W) or (H, W, 3), not of shape {values.shape}")
    if values.size == 0:
        raise BadInputError(f"{name} is empty: its shape is {values.shape}")
    values = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
    if values.dtype == np.bool_:
        values = values.astype(np.uint8) * np.uint8(255)
    if values.dtype.kind == "f":
        if not np.all((values >= 0) & (values <= 1)):  # also for NaN
            raise _other_values(values, name)
        values = np.asarray(values * 255 + 0.5, np.uint8)
    if values.dtype not in (np.uint8, np.uint16):
        raise _other_values(values, name)
    if values.ndim == 3:
        colour = np.ascontiguousarray(values[..., :3])
        values = values[..., 0] if values.shape[2] == 1 else cv2.cvtColor(colour, _TO_GREY[rgb])
    if values.dtype == np.uint16:
        values = (find_span(1, lambda _: values) if span is None else span)(np.asarray(values, np.uint16))
    grey: GreyImage = np.require(values, np.uint8, ["C", "W"])
    return grey


_TO_GREY = {False: cv2.COLOR_BGR2GRAY, True: cv2.COLOR_RGB2GRAY}


def _other_values(values: NDArray[Any], name: str) -> BadInputError:
    if values.dtype.kind == "f":
        return BadInputError(
            f"{name} has values of type {values.dtype} from {values.min()} to {values.max()}, but an image of floats must "
            "have finite values from 0 to 1: divide it by 255, or convert it to 8 bits"
        )
    return BadInputError(
        f"{name} has values of type {values.dtype}: convert it, an image must be uint8, uint16 or float in [0, 1], not "
        f"{values.dtype}"
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
