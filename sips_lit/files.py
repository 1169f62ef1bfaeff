"""Files that are there whole or not at all, and names that are safe for them."""

from __future__ import annotations

import codecs
import contextlib
import csv
import errno
import io
import os
import re
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sips_lit.errors import BadInputError, StorageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from _typeshed import ReadableBuffer as Buffer

FULL = (errno.ENOSPC, errno.EDQUOT)  # no space left, a quota used up
LONGEST_NAME = 255  # bytes of a file or folder's name on all common systems


def make_folder(path: Path) -> None:
    """Makes a folder and those above it. Raises StorageError when that is not possible."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot make the folder {path} ({error.strerror}): choose another place") from error


def write_whole(path: Path, content: Buffer) -> None:
    """Writes a file; a reader, also after a crash, finds the old content or the new one, never half of one.

    Raises StorageError when it cannot be written.
    """
    write_together({path: content})


def write_together(contents: Mapping[Path, Buffer]) -> None:
    """Writes files that belong together, each as `write_whole`: none gets its name before all are on the disk.

    Raises StorageError when one cannot be written.
    """
    # no other process has this name, on another machine either, nor another thread
    temporary = {path: path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.tmp") for path in contents}
    path = next(iter(contents))
    try:
        for path, content in contents.items():
            with temporary[path].open("wb") as handle:
                handle.write(content)
                handle.flush()
                os.fsync(handle.fileno())  # else a crash after the renaming may leave an empty file
        for path, unnamed in temporary.items():
            unnamed.replace(path)
    except BaseException as error:
        for unnamed in temporary.values():
            with contextlib.suppress(OSError):
                unnamed.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise StorageError(unwritten(path, error)) from error
        raise


class Unfinished:
    """A file that is written piece by piece, as ``temporary``; it gets its name, ``path``, when it is whole."""

    def __init__(self, path: Path) -> None:
        """Makes the folder. Raises BadInputError where that is not possible, or ``path`` is a folder."""
        make_folder(path.parent)
        self.path, self.temporary = path, path.with_name(f".{path.name}.unfinished")
        if path.is_dir():
            raise BadInputError(f"cannot write {path}, which is a folder: choose another output folder")

    def finish(self) -> None:
        """Gives the closed file its name. Raises BadInputError when it can't be written; it is removed then."""
        try:
            with self.temporary.open("rb+") as file:
                os.fsync(file.fileno())
            self.temporary.replace(self.path)
        except OSError as error:
            self.discard()
            raise BadInputError(unwritten(self.path, error)) from error

    def discard(self) -> None:
        """Removes what was written."""
        with contextlib.suppress(OSError):
            self.temporary.unlink(missing_ok=True)


def unwritten(path: Path, error: OSError) -> str:
    """Why a file could not be written, with the disk if it is full."""
    full = error.errno in FULL
    what = f"cannot write {path}: the disk {disk_of(path)} is full" if full else f"cannot write {path}"
    return f"{what} ({error.strerror}): free some space, or write elsewhere"


def disk_of(path: Path) -> Path:
    """The folder at which the file system of a path is mounted."""
    path = path.resolve()
    while not path.is_mount() and path != path.parent:
        path = path.parent
    return path


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, or of the kind that its byte order mark tells, as Windows writes it.

    Raises OSError, and UnicodeDecodeError for what is no text.
    """
    data = path.read_bytes()
    marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return data.decode("utf-16" if marked else "utf-8-sig")


def can_be_path(name: str) -> bool:
    """Whether a file system may have a file of that name, with its folders."""
    try:
        parts = [os.fsencode(part) for part in re.split(r"[/\\]", name)]
    except UnicodeEncodeError:
        return False
    return all(len(part) <= LONGEST_NAME and b"\0" not in part for part in parts)


def write_csv(path: Path, rows: Iterable[Iterable[Any]]) -> None:
    """Writes rows as CSV, whole or not at all: None as nothing, a float as the shortest text that reads back exactly.

    Raises BadInputError when it cannot be written.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_whole(path, text.getvalue().encode())


def safe_name(name: str) -> str:
    """The name with everything but letters, digits, dots, minus and underscore replaced."""
    return re.sub(r"[^\w.-]+", "_", name) or "sequence"
