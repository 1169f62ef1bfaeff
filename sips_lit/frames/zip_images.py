"""A zip archive of images as a sequence, read in place: nothing is unpacked."""

from __future__ import annotations

import functools
import hashlib
import re
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

from numpy.typing import NDArray

from sips_lit.archives.zip_members import check_member, list_members, read_member
from sips_lit.errors import BadInputError
from sips_lit.files import can_be_path, safe_name
from sips_lit.frames.images import GREY_VERSION, decode_values, resize_max_side, to_grey
from sips_lit.frames.listing import IMAGE_SUFFIXES, name_key, natural
from sips_lit.frames.span import Span, find_span
from sips_lit.types import GreyImage, ImageSequence

SEPARATOR = re.compile(r"[/\\]")


class ZipSequence(ImageSequence):
    """The images of a zip archive in the natural order of their names, all of one size.

    The sequence holds no open file: it pickles, and processes and threads may share it (see `read_member`).
    Raises BadInputError for a file that is no archive or truncated, a member whose name leaves the archive's own folder or
    that is encrypted or packed in another way than deflated, and fewer than two images.
    """

    def __init__(self, path: Path, max_side: int | None = None, name: str | None = None) -> None:
        self.path, self.max_side = path, max_side
        self.members = list_images(path)
        if len(self.members) < 2:
            count = "one image" if self.members else "no image"
            raise BadInputError(f"the archive {path} has {count}: a sequence needs two or more, download it again")
        self.name = safe_name(name or path.stem)
        contents = [(member.filename, member.file_size, member.CRC) for member in self.members]
        self.fingerprint = hashlib.sha256(repr((contents, max_side, GREY_VERSION)).encode()).hexdigest()[:16]
        self._shape: tuple[int, ...] | None = None

    def __len__(self) -> int:
        return len(self.members)

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``. Raises BadInputError when it can't be read or is not of the size of the first frame."""
        image = self._read(index)
        if self._shape is None:
            self._shape = image.shape if index == 0 else self._read(0).shape
        if image.shape != self._shape:
            raise BadInputError(
                f"{self.members[index].filename} in {self.path} is {image.shape[1]}x{image.shape[0]}, but the first image "
                f"is {self._shape[1]}x{self._shape[0]}: the images of a sequence must have one size"
            )
        return resize_max_side(image, self.max_side)

    def notes(self) -> list[str]:
        """Which values of 16-bit images are used."""
        return self.span.notes()

    def frame_name(self, index: int) -> str:
        """The member's name without folder and suffix."""
        return safe_name(PurePosixPath(self.members[index].filename).stem)

    @functools.cached_property
    def span(self) -> Span:
        """Which 16-bit values become 0 to 255: one span for all images."""
        return find_span(len(self), self._values)

    def _read(self, index: int) -> GreyImage:
        return to_grey(self._values(index), self._where(index), self.span)

    def _values(self, index: int) -> NDArray[Any]:
        return decode_values(read_member(self.path, self.members[index]), self._where(index))

    def _where(self, index: int) -> str:
        return f"{self.members[index].filename} in {self.path}"


def list_images(path: Path) -> list[zipfile.ZipInfo]:
    """The images of an archive in natural order; folders, hidden files and other files are passed over.

    Raises BadInputError as `ZipSequence` says.
    """
    images = [entry for entry in list_members(path) if _is_image(entry)]
    for entry in images:
        if not can_be_path(entry.filename):
            raise BadInputError(
                f"{path} has a member whose name is longer than that of any file: do not trust this archive"
            )
        if ".." in SEPARATOR.split(entry.filename) or re.match(r"[/\\]|[A-Za-z]:", entry.filename):
            raise BadInputError(
                f"the archive {path} has a member {entry.filename}, which leaves the folder: do not trust this archive"
            )
        check_member(path, entry, "unpack the archive into a folder images/ beside it")
    key = name_key([PurePosixPath(entry.filename).name for entry in images])
    return sorted(images, key=lambda entry: _place(entry.filename, key))


def _place(name: str, key: Callable[[str], Any]) -> tuple[Any, ...]:
    """What orders a member: its folder, then its name."""
    path = PurePosixPath(name)
    return natural(str(path.parent)), key(path.name), name


def _is_image(entry: zipfile.ZipInfo) -> bool:
    parts = SEPARATOR.split(entry.filename)
    hidden = any(part == "__MACOSX" or (part.startswith(".") and part not in (".", "..")) for part in parts)
    return not hidden and PurePosixPath(parts[-1]).suffix.lower() in IMAGE_SUFFIXES  # a folder's last part is empty
