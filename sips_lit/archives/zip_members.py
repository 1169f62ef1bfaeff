"""Members of a zip archive, read in place: as long as the archive announces them, and never longer."""

from __future__ import annotations

import functools
import zipfile
from collections.abc import Iterable
from pathlib import Path
from threading import get_native_id
from typing import Final

from sips_lit.errors import BadInputError

LARGEST: Final = 2**28
"""Bytes of what is read at once; a small archive that claims more is an attack or damaged."""
OPEN_ARCHIVES = 64  # a process keeps at most so many open: the 50 of TUM mono fit, a limit of 1024 open files is far
ENCRYPTED = 1  # of the flag bits


def list_members(path: Path, kind: str = "a zip archive") -> list[zipfile.ZipInfo]:
    """The table of contents of an archive, folders too. Raises BadInputError where it is none, which says ``kind``."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.infolist()
    except OSError as error:
        raise BadInputError(f"cannot read the archive {path}: {error.strerror or error}") from error
    except Exception as error:  # damaged bytes make zipfile raise almost anything
        raise BadInputError(
            f"{path} is not {kind}, or is truncated: compare its size with the original's, and get it again"
        ) from error


def is_bomb(path: Path, members: Iterable[zipfile.ZipInfo]) -> bool:
    """Whether members claim more bytes together than an archive may hold: `LARGEST`, or its own size if that is more."""
    return sum(max(m.file_size, m.compress_size) for m in members) > max(LARGEST, path.stat().st_size)


def check_member(path: Path, member: zipfile.ZipInfo, instead: str) -> None:
    """Raises BadInputError for a member that `read_member` can't read: encrypted, not stored or deflated, too large.

    ``instead`` says what to do about the first two. What an archive that is itself larger than `LARGEST` holds may be as
    large as that.
    """
    where = f"{member.filename} in {path}"
    if member.flag_bits & ENCRYPTED:
        raise BadInputError(f"{where} is encrypted: {instead}")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BadInputError(f"{where} is packed by a method other than deflate: {instead}")
    if is_bomb(path, [member]):
        raise BadInputError(f"{where} claims {member.file_size} bytes, more than there can be: download it again")


def read_member(path: Path, member: zipfile.ZipInfo) -> bytes:
    """The unpacked bytes of a member. Raises BadInputError when they are not what the archive's table of contents says.

    To open an archive of 4000 images takes 45 ms, so it stays open for the next member. Every thread has its own: two
    processes that read one open archive after a fork would move each other's position in it.
    """
    try:
        state = path.stat()
        # no two living threads of any processes have the same native identifier
        archive = _opened(path, (state.st_ino, state.st_size, state.st_mtime_ns), get_native_id())
        with archive.open(member) as file:
            data = file.read(member.file_size + 1)  # read() without a size would unpack a bomb whole
        if len(data) != member.file_size:
            raise zipfile.BadZipFile("shorter than announced")
    except OSError as error:
        raise BadInputError(f"cannot read the archive {path}: {error.strerror or error}") from error
    except Exception as error:  # damaged bytes make zipfile raise almost anything
        raise BadInputError(f"{member.filename} in {path} is damaged: download the archive again") from error
    return data


@functools.lru_cache(OPEN_ARCHIVES)
def _opened(path: Path, state: tuple[int, ...], thread: int) -> zipfile.ZipFile:
    archive = zipfile.ZipFile(path)
    archive.filelist.clear()  # megabytes that the caller has already
    archive.NameToInfo.clear()
    return archive
