"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from sips_lit.errors import BadInputError


def make_folder(path: Path) -> None:
    """Makes a folder and those above it. Raises BadInputError when that is not possible."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"cannot make the folder {path} ({error.strerror}): choose another place") from error


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file; a reader, also after a crash, finds the old content or the new one, never half of one.

    Raises BadInputError when it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as handle:
            handle.write(content)
            handle.flush()
            os.fsync(handle.fileno())  # else a crash after the renaming may leave an empty file
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise BadInputError(f"cannot write {path} ({error.strerror}): free some space, or write elsewhere") from error
