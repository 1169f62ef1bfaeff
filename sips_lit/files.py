"""Files that are there whole or not at all, and names that are safe for them."""

from __future__ import annotations

import csv
import io
import os
import re
import uuid
from collections.abc import Iterable
from pathlib import Path
from typing import Any

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
    # no other process has this name, on another machine either, nor another thread
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.tmp")
    try:
        with temporary.open("wb") as handle:
            handle.write(content)
            handle.flush()
            os.fsync(handle.fileno())  # else a crash after the renaming may leave an empty file
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise BadInputError(f"cannot write {path} ({error.strerror}): free some space, or write elsewhere") from error


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
