"""How large an image is, from the header of its file."""

from __future__ import annotations

from pathlib import Path

from PIL import Image, UnidentifiedImageError

from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey


def image_size(path: Path) -> tuple[int, int]:
    """(W, H) of an image file as `read_grey` gives it (whatever its EXIF orientation), without decoding.

    Kinds that Pillow doesn't know are decoded. Raises BadInputError when the file can't be read or is not an image.
    """
    try:
        with Image.open(path) as image:
            return image.size
    except (UnidentifiedImageError, Image.DecompressionBombError, ValueError, SyntaxError):
        height, width = read_grey(path).shape
        return width, height
    except OSError as error:
        raise BadInputError(f"cannot read the image {path}: {error.strerror or error}") from error
