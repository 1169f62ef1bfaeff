"""The records of a benchmark as strict JSON, and back with the same numbers.

JSON knows neither NaN nor infinity: NaN (undefined) is stored as null, infinity (a failure) as the text "inf".
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import AtBudget, MethodResult, PairSetResult, PairTable
from sips_lit.files import write_whole
from sips_lit.metrics.calibration import CalibrationResult

FORMAT: Final = "sips_lit benchmark 1"


@dataclass(frozen=True, slots=True)
class StoredBenchmark:
    """The records of a benchmark, when they were made (as given) and on which machine: all that its report needs."""

    results: list[PairSetResult]
    date: str | None
    machine: dict[str, str]


def store_results(
    path: Path, results: Sequence[PairSetResult], date: str | None = None, machine: Mapping[str, str] | None = None
) -> None:
    """Writes all records. Raises BadInputError when the file cannot be written."""
    about = {"format": FORMAT, "date": date, "machine": dict(machine or {})}
    content = {**about, "pair_sets": [_pair_set(result) for result in results]}
    write_whole(path, (json.dumps(content, allow_nan=False) + "\n").encode())


def load_results(path: Path) -> StoredBenchmark:
    """What `store_results` wrote; protocols come back as JSON has them (lists for tuples).

    Raises BadInputError when there is no such file, or it is none of these.
    """
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise BadInputError(f"cannot read {path} ({error.strerror}): give the results.json of a benchmark") from error
    except ValueError as error:
        raise BadInputError(f"{path} is not JSON ({error}): run the benchmark again to write it anew") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise BadInputError(f"{path} is not a '{FORMAT}': give the results.json that this version's benchmark wrote")
    try:
        results = [_read_pair_set(stored) for stored in content["pair_sets"]]
        return StoredBenchmark(results, content["date"], content["machine"])
    except (KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"{path} is damaged ({error!r}): run the benchmark again to write it anew") from error


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


def _read_pair_set(stored: Mapping[str, Any]) -> PairSetResult:
    detectors = tuple(_read_detector(detector) for detector in stored["detectors"])
    return PairSetResult(stored["key"], stored["title"], stored["protocol"], detectors, stored["skipped"])


def _read_detector(stored: Mapping[str, Any]) -> MethodResult:
    pairs, ks = stored["pairs"], tuple(stored["ks"])
    count = len(pairs["name"])
    budgets = [_read_budget(budget, count) for budget in stored["budgets"]]
    return MethodResult(
        key=stored["key"],
        name=stored["name"],
        protocol=stored["protocol"],
        pairs=PairTable(
            tuple(pairs["name"]), _floats(pairs["overlap"]), _floats(pairs["rotation"]), _floats(pairs["translation"])
        ),
        ks=ks,
        n_max=stored["n_max"],
        n_k=_floats(stored["n_k"], count, -1, len(ks)),
        rotation_error=_floats(stored["rotation_error"], count, -1, len(ks)),
        translation_error=_floats(stored["translation_error"], count, -1, len(ks)),
        points0=np.array(stored["points0"], np.int64),
        points1=np.array(stored["points1"], np.int64),
        budgets={budget.n: budget for budget in budgets},
        calibration={int(n): _read_calibration(c) for n, c in stored["calibration"].items()},
        milliseconds={stage: float(_number(time)) for stage, time in stored["milliseconds"].items()},
        defects=stored["defects"],
    )


def _read_budget(stored: Mapping[str, Any], count: int) -> AtBudget:
    return AtBudget(
        n=stored["n"],
        matches=np.array(stored["matches"], np.int64),
        inliers=np.array(stored["inliers"], np.int64).reshape(_shape(stored["inliers"], count, -1)),
        rotation_error=_floats(stored["rotation_error"], count, -1),
        translation_error=_floats(stored["translation_error"], count, -1),
        outcome=np.array(stored["outcome"], np.int64).reshape(_shape(stored["outcome"], count, -1)),
        repeatability=_floats(stored["repeatability"]),
        matching_score=_floats(stored["matching_score"]),
        spread=_floats(stored["spread"]),
    )


def _read_calibration(stored: Mapping[str, Any]) -> CalibrationResult:
    return CalibrationResult(
        ece=_number(stored["ece"]),
        mce=_number(stored["mce"]),
        brier=_number(stored["brier"]),
        edges=_floats(stored["edges"]),
        count=np.array(stored["count"], np.int64),
        mean_score=_floats(stored["mean_score"]),
        frequency=_floats(stored["frequency"]),
    )


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _floats(values: Sequence[Any], *shape: int) -> NDArray[np.float64]:
    """Nested lists of numbers, null and "inf" as float64; of no pairs at all the ``shape`` has 0 for -1."""
    array = np.array(values, object)
    numbers = np.array([_number(value) for value in array.ravel()], np.float64)
    return numbers.reshape(_shape(values, *shape)) if shape else numbers


def _shape(values: Sequence[Any], *shape: int) -> tuple[int, ...]:
    return shape if len(values) else tuple(max(length, 0) for length in shape)
