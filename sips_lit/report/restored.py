"""Results from the JSON that `sips_lit.report.stored` writes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import AtBudget, MethodResult, PairSetResult, PairTable
from sips_lit.files import read_text
from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.metrics.covariance import CovarianceReliability
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.stored import FORMAT

Record = TypeVar("Record")
_COUNTS = frozenset({"matches", "inliers", "outcome", "points0", "points1", "count"})


@dataclass(frozen=True, slots=True)
class Restored:
    """What a file ``path`` of results holds.

    ``pictures`` by the keys of pair set and method, those whose files are still there.
    """

    path: Path
    results: tuple[PairSetResult, ...]
    date: str | None
    machine: Mapping[str, str]
    pictures: Mapping[tuple[str, str], Sequence[PairPicture]]


def restore_results(path: Path) -> Restored:
    """Everything in a ``results.json``.

    Raises BadInputError for a file that can't be read, that is none, or that lacks something, as those of early versions do.
    """
    file = path / "results.json" if path.is_dir() else path
    try:
        content = json.loads(read_text(file))
    except OSError as error:
        raise BadInputError(f"the results {file} can't be read: {error.strerror}") from error
    except ValueError as error:  # no JSON, no text
        raise BadInputError(f"{file} is damaged or no results of an evaluation: give its results.json") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise BadInputError(f"{file} holds no results of an evaluation: give the results.json of sips-benchmark")
    try:
        results = tuple(_pair_set(entry) for entry in content["pair_sets"])
        pictures = _pictures(file.parent, content.get("pictures", ()))
        return Restored(file, results, content["date"], content["machine"], pictures)
    except KeyError as error:
        raise BadInputError(
            f"{file} lacks {error.args[0]}, as another version of sips_lit wrote it: measure once more to draw it"
        ) from error
    except (TypeError, ValueError, AttributeError) as error:  # values of other kinds and shapes, as someone edited it
        raise BadInputError(f"{file} is damaged ({error}): measure once more to draw it") from error


def _pair_set(entry: Mapping[str, Any]) -> PairSetResult:
    methods = tuple(map(_method, entry["detectors"]))
    return PairSetResult(entry["key"], entry["title"], entry["protocol"], methods, entry["skipped"])


def _method(entry: Mapping[str, Any]) -> MethodResult:
    pairs = entry["pairs"]
    arrays = ("n_k", "n_k_judged", "unknown", "rotation_error", "translation_error", "points0", "points1")
    return MethodResult(
        **{name: entry[name] for name in ("key", "name", "protocol", "n_max", "milliseconds", "defects")},
        **{name: _array(name, entry[name]) for name in arrays},
        ks=tuple(entry["ks"]),
        pairs=_record(PairTable, pairs, name=tuple(pairs["name"])),
        budgets={at["n"]: _record(AtBudget, at, n=at["n"]) for at in entry["budgets"]},
        calibration={int(n): _scored(CalibrationResult, of) for n, of in entry["calibration"].items()},
        covariance={int(n): _scored(CovarianceReliability, of) for n, of in entry.get("covariance", {}).items()},
    )


def _scored(kind: type[Record], entry: Mapping[str, Any]) -> Record:
    """A record of arrays and single numbers."""
    numbers = {name: _number(value) for name, value in entry.items() if not isinstance(value, list)}
    return _record(kind, entry, **numbers)


def _record(kind: type[Record], entry: Mapping[str, Any], **others: Any) -> Record:
    """A record of arrays, but for ``others``."""
    names = [field.name for field in fields(kind) if field.name not in others]  # type: ignore[arg-type]
    return kind(**others, **{name: _array(name, entry[name]) for name in names})


def _array(name: str, values: Any) -> Any:
    """Nested lists, in which None is NaN and "inf" infinity, as float64, or int64 where things are counted."""
    if name in _COUNTS:
        return np.array(values, np.int64)
    return np.array(values, object).astype(np.float64) if values else np.zeros(0)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _pictures(folder: Path, entries: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], list[PairPicture]]:
    pictures: dict[tuple[str, str], list[PairPicture]] = {}
    for entry in entries:
        file = folder / entry["file"]
        if file.is_file():
            drawn = pictures.setdefault((entry["pair_set"], entry["method"]), [])
            drawn.append(PairPicture(entry["label"], file, entry["caption"]))
    return pictures
