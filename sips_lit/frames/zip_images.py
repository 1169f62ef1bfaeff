"""A zip archive of images as a sequence, read in place: nothing is unpacked."""

from __future__ import annotations

import hashlib
import re
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.images import IMAGE_SUFFIXES, decode_grey, natural, resize_max_side
from sips_lit.types import GreyImage, ImageSequence

LARGEST_MEMBER = 2**28  # bytes of an unpacked image; a small archive that claims more is an attack or damaged
HEADER = struct.Struct("<4s22xHH")  # signature, and the lengths of the name and of the extra field after the header
ENCRYPTED = 1  # of the flag bits
SEPARATOR = re.compile(r"[/\\]")


@dataclass(frozen=True, slots=True)
class Member:
    """Where an image lies in the archive: ``start`` of its header and ``packed`` size, both in bytes."""

    name: str
    start: int
    packed: int
    size: int
    checksum: int
    deflated: bool


class ZipSequence(ImageSequence):
    """The images of a zip archive in the natural order of their names, all of one size.

    Every frame opens the archive anew, as reading an image file would: processes and threads share nothing, and the sequence
    pickles. Raises BadInputError for a file that is no archive or truncated, a member whose name leaves the archive's own
    folder or that is encrypted or packed in another way than deflated, and fewer than two images.
    """

    def __init__(self, path: Path, max_side: int | None = None, name: str | None = None) -> None:
        self.path, self.max_side = path, max_side
        self.members = list_members(path)
        if len(self.members) < 2:
            count = "one image" if self.members else "no image"
            raise BadInputError(f"the archive {path} has {count}: a sequence needs two or more, download it again")
        self.name = safe_name(name or path.stem)
        contents = [(member.name, member.size, member.checksum) for member in self.members]
        self.fingerprint = hashlib.sha256(repr((contents, max_side)).encode()).hexdigest()[:16]
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
                f"{self.members[index].name} in {self.path} is {image.shape[1]}x{image.shape[0]}, but the first image is "
                f"{self._shape[1]}x{self._shape[0]}: the images of a sequence must have one size"
            )
        return resize_max_side(image, self.max_side)

    def frame_name(self, index: int) -> str:
        """The member's name without folder and suffix."""
        return safe_name(PurePosixPath(self.members[index].name).stem)

    def _read(self, index: int) -> GreyImage:
        member = self.members[index]
        return decode_grey(read_member(self.path, member), f"{member.name} in {self.path}")


def list_members(path: Path) -> list[Member]:
    """The images of an archive in natural order; folders, hidden files and other files are passed over.

    Raises BadInputError as `ZipSequence` says.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except OSError as error:
        raise BadInputError(f"cannot read the archive {path}: {error.strerror or error}") from error
    except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        raise BadInputError(
            f"{path} is not a zip archive, or is truncated: compare its size with the published one and download it again"
        ) from error
    images = [entry for entry in entries if _is_image(entry)]
    return [
        _member(path, entry) for entry in sorted(images, key=lambda entry: (natural(entry.filename), entry.filename))
    ]


def read_member(path: Path, member: Member) -> bytes:
    """The unpacked bytes of a member. Raises BadInputError when they are not what the archive's table of contents says."""
    try:
        with path.open("rb") as file:
            file.seek(member.start)
            header = file.read(HEADER.size)
            signature, name_length, extra_length = HEADER.unpack(header) if len(header) == HEADER.size else (b"", 0, 0)
            # not the lengths of the table of contents: writers may give the extra field another length here
            file.seek(name_length + extra_length, 1)
            packed = file.read(member.packed)
    except OSError as error:
        raise BadInputError(f"cannot read the archive {path}: {error.strerror or error}") from error
    try:
        # never more than announced, whatever the packed bytes would grow to
        data = zlib.decompressobj(-zlib.MAX_WBITS).decompress(packed, member.size + 1) if member.deflated else packed
    except zlib.error:
        data = b""
    if signature != b"PK\x03\x04" or len(data) != member.size or zlib.crc32(data) != member.checksum:
        raise BadInputError(f"{member.name} in {path} is damaged: download the archive again")
    return data


def _is_image(entry: zipfile.ZipInfo) -> bool:
    parts = SEPARATOR.split(entry.filename)
    hidden = any(part == "__MACOSX" or (part.startswith(".") and part not in (".", "..")) for part in parts)
    return not entry.is_dir() and not hidden and PurePosixPath(parts[-1]).suffix.lower() in IMAGE_SUFFIXES


def _member(path: Path, entry: zipfile.ZipInfo) -> Member:
    name = entry.filename
    if ".." in SEPARATOR.split(name) or re.match(r"[/\\]|[A-Za-z]:", name):
        raise BadInputError(
            f"the archive {path} has a member {name}, which leaves the folder: do not trust this archive"
        )
    if entry.flag_bits & ENCRYPTED:
        raise BadInputError(f"{name} in {path} is encrypted: unpack the archive into a folder images/ beside it")
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BadInputError(
            f"{name} in {path} is packed by a method other than deflate: unpack the archive into a folder images/ beside it"
        )
    if max(entry.file_size, entry.compress_size) > LARGEST_MEMBER:
        raise BadInputError(
            f"{name} in {path} claims {entry.file_size} bytes, too many for an image: download it again"
        )
    deflated = entry.compress_type == zipfile.ZIP_DEFLATED
    return Member(name, entry.header_offset, entry.compress_size, entry.file_size, entry.CRC, deflated)
