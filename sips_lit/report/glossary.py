"""What every number of a report means, and what happens where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import OWN_N, columns_of

_BASICS: Final = {
    "n_k, points needed": "The fewest points that must be taken from each image, best first, so that k of the matches "
    "between them are inliers. The points are matched anew for every n.",
    "succinctness curve s(n)": "Fraction of the pairs whose n_k is at most n.",
    "own and common descriptor": "A detector that describes its points is listed by its name alone (dashed lines); "
    "with a descriptor that others use, too, as “detector + descriptor” (solid lines).",
    "control": "Points that ignore the image (random, or on a grid). A detector that does not beat them has learned "
    "nothing.",
    OWN_N: "The points have no scores (LF-Net), so their order says nothing: all points of an image are judged together, or "
    "none. n_k is their number if they give k inliers, else infinite, so its AUC is a lower bound; what is measured at a "
    "budget is left out where there are more points than that.",
}
_CASES: Final = {
    "fewer points than asked for": "Legal: budgets beyond take all there are. “Points found” tells.",
    "no points, or no matches": "No inliers: the pair is a failure.",
    "NaN, infinite, outside, duplicate or unsorted points": "Taken out, or put in order, and counted under “defects”; so "
    "are points beyond those asked for, and images with fewer points or none.",
    "failure": "A pair that does not have k inliers at any n up to n_max has an infinite n_k. “never” in a table means "
    "that the wanted fraction of pairs never gets there.",
    "unknown truth": "A match whose true position is not known (no depth there, say) is neither inlier nor outlier.",
    "pairs without depth": "Where the verification needs depth and neither image of a pair has any (or needs the pose and "
    "it is not known), nobody can judge the pair: it is left out for all detectors alike, and named in the protocol. "
    "Verified otherwise, such a pair has no pose errors.",
    "fewer than 4 correspondences": "Too few with a depth for P3P with RANSAC: no pose, an infinite error, counted under "
    "“pairs without a pose”. Verification by P3P finds no inliers then.",
    "RANSAC finds nothing": "No pose that three matches agree with: as with fewer than 4 correspondences.",
    "a pose of few inliers": "At a budget a pose with fewer inliers than the protocol asks for (pose inliers) counts as "
    "none.",
    "- (a dash)": "Undefined, or not measured: pose errors where no true pose is known, calibration of scores that are no "
    "probabilities, times of results that were computed earlier. A column without any value is left out.",
}


def glossary_html(results: Sequence[PairSetResult]) -> str:
    """The definitions of all columns that any table has, and of the cases in which a number is missing."""
    entries = dict(_BASICS)
    for result in results:
        for column in columns_of(result.detectors):
            entries.setdefault(column.title, column.definition)
    return f"<dl>{_list(entries)}</dl>\n<h3>Where there is no number</h3>\n<dl>{_list(_CASES)}</dl>"


def _list(entries: dict[str, str]) -> str:
    return "".join(f"<dt>{escape(term)}</dt><dd>{escape(meaning)}</dd>" for term, meaning in entries.items())
