"""What went wrong, counted for each detector: in its points, and in the poses that they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from sips_lit.evaluate.pair_pose import PoseOutcome
from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.summary import main_budget

_OUTCOMES: Final = {
    PoseOutcome.FOUND: "with a pose",
    PoseOutcome.FEW_MATCHES: "fewer than 4 correspondences",
    PoseOutcome.NO_AGREEMENT: "RANSAC finds nothing",
    PoseOutcome.FEW_INLIERS: "a pose of few inliers",
    PoseOutcome.UNKNOWN: "truth or depth unknown",
}


def defects_html(result: PairSetResult) -> str:
    """What was wrong with the points that the detectors returned, over all images; empty without detectors."""
    rows = {detector.name: detector.defects for detector in result.detectors}
    return _folded("Defects in what the detectors returned", rows)


def without_pose_html(result: PairSetResult) -> str:
    """How many pairs have a pose at the budget of the table, and why the others have none; empty without a budget."""
    n = main_budget(result.detectors[0]) if result.detectors else None
    if n is None:
        return ""
    measured = [detector for detector in result.detectors if n in detector.budgets]
    came = [kind for kind in _OUTCOMES if any((d.budgets[n].outcome == kind).any() for d in measured)]
    if came in ([], [PoseOutcome.UNKNOWN]):
        return ""
    rows = {d.name: {_OUTCOMES[kind]: int((d.budgets[n].outcome == kind).sum()) for kind in came} for d in measured}
    repeats = max(detector.n_k.shape[1] for detector in result.detectors)
    each = f", each in {repeats} repeats" if repeats > 1 else ""
    return _folded(f"Pairs without a pose at {n} points{each}", rows)


def _folded(title: str, rows: Mapping[str, Mapping[str, int]]) -> str:
    kinds: Sequence[str] = list(dict.fromkeys(kind for counts in rows.values() for kind in counts))
    if not kinds:
        return ""
    heads = "".join(f'<th scope="col">{escape(kind)}</th>' for kind in kinds)
    lines = "".join(
        f"<tr><td>{escape(name)}</td>" + "".join(f"<td>{counts.get(kind, 0)}</td>" for kind in kinds) + "</tr>"
        for name, counts in rows.items()
    )
    head = f'<thead><tr><th scope="col">detector</th>{heads}</tr></thead>'
    table = f'<div class="scroll"><table>{head}<tbody>{lines}</tbody></table></div>'
    return f"<details><summary>{escape(title)}</summary>{table}</details>"
