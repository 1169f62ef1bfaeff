"""What went wrong, counted for each method: in its points, and in the poses that they give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from sips_lit.evaluate.result import PairSetResult, PoseOutcome
from sips_lit.report.summary import at_main_budget

OUTCOMES: Final = {
    PoseOutcome.FOUND: "with a pose",
    PoseOutcome.FEW_MATCHES: "fewer than 4 correspondences",
    PoseOutcome.NO_AGREEMENT: "RANSAC finds nothing",
    PoseOutcome.FEW_INLIERS: "a pose of few inliers",
    PoseOutcome.UNKNOWN: "truth or depth unknown",
}


@dataclass(frozen=True, slots=True)
class Counts:
    """A table: for each method by name, how often each of ``kinds`` came."""

    title: str
    kinds: tuple[str, ...]
    rows: Mapping[str, tuple[int, ...]]


def counts(result: PairSetResult) -> list[Counts]:
    """The tables that have something to count."""
    return [table for table in (defects(result), without_pose(result)) if table is not None]


def defects(result: PairSetResult) -> Counts | None:
    """What was wrong with the points that the detectors returned, over all images; None where nothing was counted."""
    kinds = tuple(dict.fromkeys(kind for method in result.detectors for kind in method.defects))
    if not kinds:
        return None
    title = f"Defects in what the detector{'s' if len(result.detectors) > 1 else ''} returned"
    return Counts(title, kinds, {m.name: tuple(m.defects.get(kind, 0) for kind in kinds) for m in result.detectors})


def without_pose(result: PairSetResult) -> Counts | None:
    """How many pairs have a pose at the n of the table, and why the others have none; None where no pose was estimated."""
    measured = at_main_budget(result.detectors)
    outcomes = {name: at.outcome for name, at in measured.items()}
    came = [kind for kind in OUTCOMES if any((of_pairs == kind).any() for of_pairs in outcomes.values())]
    if came in ([], [PoseOutcome.UNKNOWN]):
        return None
    repeats = max(of_pairs.shape[1] for of_pairs in outcomes.values())
    n = next(iter(measured.values())).n
    title = f"Pairs without a pose at {n} points{f', each in {repeats} repeats' if repeats > 1 else ''}"
    rows = {name: tuple(int((of_pairs == kind).sum()) for kind in came) for name, of_pairs in outcomes.items()}
    return Counts(title, tuple(OUTCOMES[kind] for kind in came), rows)
