"""What every number of a report means, and what happens where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from sips_lit.evaluate.benchmark_result import PairSetResult
from sips_lit.evaluate.report.columns import columns_of
from sips_lit.evaluate.report.summary import summary

_BASICS: Final = {
    "n_k, points needed": "The fewest points that must be taken from each image, best first, so that k of the matches "
    "between them are inliers. The points are matched anew for every n.",
    "succinctness curve s(n)": "Fraction of the pairs whose n_k is at most n.",
    "own and common descriptor": "A detector that describes its points is listed by its name alone (dashed lines); "
    "with a descriptor that others use, too, as “detector + descriptor” (solid lines).",
    "control": "Points that ignore the image (random, or on a grid). A detector that does not beat them has learned "
    "nothing.",
}
_CASES: Final = {
    "fewer points than asked for": "Legal: budgets beyond take all there are. “Points found” tells.",
    "no points, or no matches": "No inliers: the pair is a failure.",
    "NaN, infinite, outside, duplicate or unsorted points": "Taken out, or put in order, and counted under “defects”.",
    "failure": "A pair that does not have k inliers at any n up to n_max has an infinite n_k. “never” in a table means "
    "that the wanted fraction of pairs never gets there.",
    "unknown truth": "A match whose true position is not known (no depth there, say) is neither inlier nor outlier.",
    "pairs without depth": "Where neither depth maps nor stereo partners exist, there are no pose errors; "
    "verification by P3P finds no inliers there.",
    "fewer than 4 correspondences": "Too few for P3P with RANSAC: no pose, an infinite error. "
    "Verification by P3P finds no inliers then.",
    "RANSAC finds nothing": "As with fewer than 4 correspondences.",
    "- (a dash)": "Undefined, or not measured: pose errors where no true pose is known, calibration of scores that are no "
    "probabilities, times of results that were computed earlier. A column without any value is left out.",
}


def glossary_html(results: Sequence[PairSetResult]) -> str:
    """The definitions of all columns that any table has, and of the cases in which a number is missing."""
    entries = dict(_BASICS)
    for result in results:
        for column in columns_of([summary(detector) for detector in result.detectors]):
            entries.setdefault(column.title, column.definition)
    return f"<dl>{_list(entries)}</dl>\n<h3>Where there is no number</h3>\n<dl>{_list(_CASES)}</dl>"


def _list(entries: dict[str, str]) -> str:
    return "".join(f"<dt>{escape(term)}</dt><dd>{escape(meaning)}</dd>" for term, meaning in entries.items())
