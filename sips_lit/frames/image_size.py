"""How large an image is, from the header of its file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from PIL import ExifTags, Image, UnidentifiedImageError

from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey


def image_size(path: Path) -> tuple[int, int]:
    """(W, H) of an image file as `read_grey` gives it, upright, without decoding.

    Kinds that Pillow doesn't know are decoded. Raises BadInputError when the file can't be read or is not an image.
    """
    try:
        with Image.open(path) as image:
            return image.size[::-1] if _on_its_side(image) else image.size
    except (UnidentifiedImageError, Image.DecompressionBombError, ValueError, SyntaxError):
        height, width = read_grey(path).shape
        return width, height
    except OSError as error:
        raise BadInputError(f"cannot read the image {path}: {error.strerror or error}") from error


def _on_its_side(image: Image.Image) -> bool:
    """Whether the size has still to be turned by the orientation tag; of a TIFF Pillow gives it turned."""
    if image.format == "TIFF" or (image.format == "PNG" and "exif" not in image.info):  # to look further is to decode
        return False
    return image.getexif().get(ExifTags.Base.Orientation) in (5, 6, 7, 8)


def first_size(files: Iterable[Path]) -> tuple[int, int] | None:
    """(W, H) of the first of the files that can be read; None where there are no files.

    Raises BadInputError for the last one where none can be read.
    """
    problem: BadInputError | None = None
    for file in files:
        try:
            return image_size(file)
        except BadInputError as error:
            problem = error
    if problem is not None:
        raise problem
    return None
