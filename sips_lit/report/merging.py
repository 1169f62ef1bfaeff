"""Results of several runs in one report: methods on the same pairs in one table, if they were measured in the same way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.report.labels import labelled, refuse_unknown_labels
from sips_lit.report.page import PairPictures
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.restored import Restored
from sips_lit.report.stored import plain

OF_METHOD = frozenset({"detector", "descriptor", "checkpoint", "scores", "extracted", "versions"})
"""What methods in one table may differ in."""


@dataclass(frozen=True, slots=True)
class Merged:
    """Pair sets of several files; ``notes``: sentences that say which were not put into one table, and why."""

    results: tuple[PairSetResult, ...]
    pictures: PairPictures
    date: str | None
    machine: Mapping[str, str]
    notes: tuple[str, ...]


def merge(files: Sequence[Restored], labels: Mapping[str, str]) -> Merged:
    """The pair sets of all files, those of the same pairs and the same protocol as one.

    ``labels``: see `labelled`; with ``2/`` before it a name is that of a method in the second file alone. Raises
    BadInputError for labels of none, and for two methods of one name in one table.
    """
    _refuse_unknown(files, labels)
    results: list[PairSetResult] = []
    pictures: dict[tuple[str, str], Sequence[PairPicture]] = {}
    notes: list[str] = []
    for number, file in enumerate(files, 1):
        for result in file.results:
            named = labelled_in_file(result, labels, number)
            at = next((at for at, other in enumerate(results) if not differences(other, named)), None)
            if at is None:
                notes += _apart(results, named, str(file.path))
                key = _unused(named.key, [other.key for other in results])
                title = named.title if key == named.key else f"{named.title} ({file.path.parent.name})"
                results.append(replace(named, key=key, title=title))
                keys = [method.key for method in named.detectors]
            else:
                key = results[at].key
                results[at], keys = _joined(results[at], named, number)
            for method, own in zip(named.detectors, keys, strict=True):
                if (result.key, method.key) in file.pictures:
                    pictures[key, own] = file.pictures[result.key, method.key]
    dates = dict.fromkeys(file.date for file in files if file.date)
    return Merged(tuple(results), pictures, ", ".join(dates) or None, _machines(files), tuple(notes))


def labelled_in_file(result: PairSetResult, labels: Mapping[str, str], number: int) -> PairSetResult:
    """`labelled` in file ``number``: labels for it alone win."""
    common = {name: label for name, label in labels.items() if "/" not in name}
    own = {name.partition("/")[2]: label for name, label in labels.items() if name.startswith(f"{number}/")}
    return labelled(labelled(result, common), own)


def differences(one: PairSetResult, other: PairSetResult) -> list[str]:
    """In which entries of the protocol two pair sets differ that could be one, ``pairs`` first; empty if they are one.

    Sets without methods are one with none.
    """
    if not one.detectors or not other.detectors:
        return ["methods"]
    found = [] if one.detectors[0].pairs.name == other.detectors[0].pairs.name else ["pairs"]
    ours, theirs = _common(one), _common(other)
    return found + [key for key in dict.fromkeys([*ours, *theirs]) if ours.get(key) != theirs.get(key)]


def _common(result: PairSetResult) -> dict[str, Any]:
    """The protocol as far as it is that of all methods."""
    first = result.detectors[0]
    own = {key: value for key, value in first.protocol.items() if key not in OF_METHOD}
    whole: dict[str, Any] = plain({**result.protocol, **own, "ks": first.ks, "n_max": first.n_max})
    return whole


def _apart(results: Sequence[PairSetResult], result: PairSetResult, file: str) -> list[str]:
    """Why a pair set is shown apart from one of the same name; nothing where none is called so."""
    alike = next((other for other in results if other.title == result.title), None)
    if alike is None or not alike.detectors or not result.detectors:
        return []
    different = differences(alike, result)
    return [f"{result.title} of {file} has a table of its own, as it differs in {', '.join(different)}"]


def _joined(one: PairSetResult, other: PairSetResult, number: int) -> tuple[PairSetResult, list[str]]:
    """One pair set with the methods of both, and the keys that those of the second have in it."""
    names, keys = {method.name for method in one.detectors}, [method.key for method in one.detectors]
    added: list[MethodResult] = []
    for method in other.detectors:
        if method.name in names:
            raise BadInputError(
                f"{method.name} on {one.title} is in two of the files: call one by another name, "
                f"'labels={{{number}/{method.key}: \"{method.name}, second\"}}', say, or leave one out"
            )
        added.append(replace(method, key=_unused(method.key, keys)))
        keys.append(added[-1].key)
    skipped = {**one.skipped, **other.skipped}
    joined = replace(one, detectors=(*one.detectors, *added), skipped=skipped)
    return joined, [method.key for method in added]


def _unused(key: str, used: Sequence[str]) -> str:
    tried = [key, *(f"{key}_{count}" for count in range(2, len(used) + 2))]
    return next(name for name in tried if name not in used)


def _machines(files: Sequence[Restored]) -> dict[str, str]:
    """The machine, or those of the files by their numbers."""
    if all(file.machine == files[0].machine for file in files):
        return dict(files[0].machine)
    return {f"{key} ({number})": value for number, file in enumerate(files, 1) for key, value in file.machine.items()}


def _refuse_unknown(files: Sequence[Restored], labels: Mapping[str, str]) -> None:
    every: list[tuple[str, str]] = []
    for number, file in enumerate(files, 1):
        methods = [method for result in file.results for method in result.detectors]
        own = [(method.key, str(method.protocol.get("descriptor", "own"))) for method in methods]
        every += [*own, *((f"{number}/{key}", descriptor) for key, descriptor in own)]
    refuse_unknown_labels(labels, every, [key for file in files for result in file.results for key in result.skipped])
