"""The summary of an index folder: one file a share, written by its machine, and a table of all of them."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
from collections.abc import Iterable
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder, write_whole
from sips_lit.pairs.index_run import IndexedSequence

COLUMNS = [field.name for field in dataclasses.fields(IndexedSequence)]
TABLE = "summary.csv"


class ShareSummary:
    """What is known of the recordings of one share, in ``folder/summary-<data>-<i>of<n>.json``.

    ``data``: text that tells data sets apart; ``recordings``: what is in the share now. What an earlier run wrote about
    them stays until it is replaced.
    """

    def __init__(self, folder: Path, data: str, shard: str, recordings: Iterable[str]) -> None:
        digest = hashlib.sha256(data.encode()).hexdigest()[:8]
        self.folder, self.path = folder, folder / f"summary-{digest}-{shard.replace('/', 'of')}.json"
        known = set(recordings)
        self._rows = {name: rows for name, rows in _read(self.path).items() if name in known}

    def add(self, rows: list[IndexedSequence]) -> None:
        """Replaces what is known of a recording."""
        self._rows[rows[0].recording] = rows

    @property
    def rows(self) -> list[IndexedSequence]:
        """In the order of their recordings."""
        return [row for name in sorted(self._rows) for row in self._rows[name]]

    def write(self) -> Path:
        """Writes the file of the share, and the table of all shares that there are now. Returns where the table is."""
        make_folder(self.folder)
        rows = [dataclasses.asdict(row) for row in self.rows]
        write_whole(self.path, (json.dumps(rows, indent=1, ensure_ascii=False) + "\n").encode())
        return write_table(self.folder)


def write_table(folder: Path) -> Path:
    """Makes ``summary.csv`` of the files of all shares; of a recording that is in several the newest counts.

    Other machines may do the same at once: who writes last has seen the files of all.
    """
    while True:
        files = _shares(folder)
        merged: dict[str, list[IndexedSequence]] = {}
        for path, _ in files:
            merged |= _read(path)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(dataclasses.astuple(row) for name in sorted(merged) for row in merged[name])
        write_whole(folder / TABLE, text.getvalue().encode())
        # else another machine wrote in between, and its table may be the one just replaced
        if _shares(folder) == files:
            return folder / TABLE


def _shares(folder: Path) -> list[tuple[Path, int]]:
    """The files of shares and when they were written, oldest first."""
    found = [(path, path.stat().st_mtime_ns) for path in folder.glob("summary-*of*.json")]
    return sorted(found, key=lambda item: (item[1], item[0]))


def _read(path: Path) -> dict[str, list[IndexedSequence]]:
    """Rows by recording; none if there is no file."""
    rows: dict[str, list[IndexedSequence]] = {}
    try:
        for values in json.loads(path.read_text(encoding="utf-8")):
            row = IndexedSequence(**values)
            rows.setdefault(row.recording, []).append(row)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise BadInputError(f"cannot read the summary {path} ({error}): remove it, it is made again") from error
    return rows
