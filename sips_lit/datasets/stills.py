"""Photographs that have nothing to do with each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sips_lit.datasets.layout import files_fingerprint
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.images import check_max_side, read_grey, resize_max_side
from sips_lit.frames.listing import images_below
from sips_lit.types import GreyImage, ImageSequence


class Stills(ImageSequence):
    """Images of any sizes in no order, shrunk where the longer side exceeds ``max_side`` (pixels)."""

    temporal = False

    def __init__(self, name: str, files: Sequence[Path], max_side: int | None = None) -> None:
        self.name, self.files, self.max_side = safe_name(name), list(files), max_side
        self.fingerprint = files_fingerprint(self.files, max_side)

    def __len__(self) -> int:
        return len(self.files)

    def frame(self, index: int) -> GreyImage:
        """Image ``index``. Raises BadInputError when it can't be read."""
        return resize_max_side(read_grey(self.files[index]), self.max_side)

    def frame_name(self, index: int) -> str:
        """The file's name without its suffix."""
        return self.files[index].stem


def stills(path: str | Path, max_side: int | None = None) -> list[ImageSequence]:
    """All images in a folder and the folders in it. Raises BadInputError where there is none."""
    check_max_side(max_side)
    folder = Path(path)
    if not folder.is_dir():
        raise BadInputError(f"there is no folder {folder}: data.path must be a folder of images")
    files = images_below(folder)
    if not files:
        raise BadInputError(f"the folder {folder} has no images (.png, .jpg, ...), nor have its subfolders")
    return [Stills(folder.resolve().name, files, max_side)]
