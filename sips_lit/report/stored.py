"""Results as strict JSON.

JSON knows neither NaN nor infinity: NaN (undefined) is stored as null, infinity (a failure) as the text "inf".
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.files import write_whole
from sips_lit.report.pair_pictures import PairPicture

FORMAT: Final = "sips_lit benchmark 1"


def store_results(
    path: Path,
    results: Sequence[PairSetResult],
    date: str | None = None,
    machine: Mapping[str, str] | None = None,
    pictures: Mapping[tuple[str, str], Sequence[PairPicture]] | None = None,
) -> None:
    """Writes all records, and where the files of ``pictures`` are, which lie below the folder of ``path``.

    Pictures by the keys of pair set and method. Raises BadInputError when the file cannot be written.
    """
    listed = [
        {"pair_set": pair_set, "method": method, "label": one.label, "caption": one.caption, "file": _below(path, one)}
        for (pair_set, method), drawn in (pictures or {}).items()
        for one in drawn
    ]
    content = {"format": FORMAT, "date": date, "machine": machine or {}, "pair_sets": results, "pictures": listed}
    write_whole(path, (json.dumps(plain(content), allow_nan=False) + "\n").encode())


def plain(value: Any) -> Any:
    """A record, or anything in one, as JSON takes it: NaN is None, infinity "inf", whole floats are integers."""
    if is_dataclass(value):
        record = {field.name: getattr(value, field.name) for field in fields(value)}
        if isinstance(value, MethodResult):
            record["budgets"] = list(value.budgets.values())  # a budget says its n itself
        return plain(record)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        if np.isnan(value):
            return None
        if np.isinf(value):
            return "inf" if value > 0 else "-inf"
        return int(value) if value.is_integer() else value
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _below(path: Path, picture: PairPicture) -> str:
    assert isinstance(picture.image, Path)
    return picture.image.relative_to(path.parent).as_posix()
