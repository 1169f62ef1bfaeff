"""Results as strict JSON.

JSON knows neither NaN nor infinity: NaN (undefined) is stored as null, infinity (a failure) as the text "inf".
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.files import write_whole

FORMAT: Final = "sips_lit benchmark 1"


def store_results(
    path: Path, results: Sequence[PairSetResult], date: str | None = None, machine: Mapping[str, str] | None = None
) -> None:
    """Writes all records. Raises BadInputError when the file cannot be written."""
    about = {"format": FORMAT, "date": date, "machine": dict(machine or {})}
    content = {**about, "pair_sets": [_pair_set(result) for result in results]}
    write_whole(path, (json.dumps(content, allow_nan=False) + "\n").encode())


def plain(value: Any) -> Any:
    """Anything in a record as JSON takes it: NaN is None, infinity "inf", whole floats are integers."""
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


def _pair_set(result: PairSetResult) -> dict[str, Any]:
    return {
        "key": result.key,
        "title": result.title,
        "protocol": plain(result.protocol),
        "skipped": dict(result.skipped),
        "detectors": [_detector(detector) for detector in result.detectors],
    }


def _fields(record: Any, *left_out: str) -> dict[str, Any]:
    return {name: plain(getattr(record, name)) for name in record.__dataclass_fields__ if name not in left_out}


def _detector(result: MethodResult) -> dict[str, Any]:
    stored = _fields(result, "pairs", "budgets", "calibration")
    stored["pairs"] = _fields(result.pairs)
    stored["budgets"] = [_fields(budget) for budget in result.budgets.values()]
    stored["calibration"] = {str(n): _fields(calibration) for n, calibration in result.calibration.items()}
    return stored
