"""A table that grows row by row, on disk."""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from sips_lit.errors import BadInputError
from sips_lit.files import Unfinished, unwritten


class CsvTable:
    """A CSV file that has its name when it is closed. Raises BadInputError, whatever is called, when it can't be written."""

    def __init__(self, path: Path) -> None:
        self.path, self.unfinished = path, Unfinished(path)
        try:
            self.file = self.unfinished.temporary.open("w", newline="", encoding="utf-8")
        except OSError as error:
            raise BadInputError(unwritten(path, error)) from error

    def append(self, rows: Iterable[Sequence[Any]]) -> None:
        """Appends rows: None is nothing, a NumPy number the shortest text that reads back exactly."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        try:
            self.file.write(text.getvalue())
            self.file.flush()
        except OSError as error:
            self._give_up(error)

    @property
    def closed(self) -> bool:
        """Whether it is finished or given up."""
        return self.file.closed

    def close(self) -> None:
        """Finishes the table, of the rows so far; one that no longer fits on the disk is removed."""
        if self.closed:
            return
        try:
            self.file.close()
        except OSError as error:
            self._give_up(error)
        self.unfinished.finish()

    def _give_up(self, error: OSError) -> NoReturn:
        with contextlib.suppress(OSError):
            self.file.close()
        self.unfinished.discard()
        raise BadInputError(unwritten(self.path, error)) from error
