"""A column of the table: one number of each method, with its title, definition, formula and digits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sips_lit.evaluate.result import FloatArray, IntArray, MethodResult

Number = Callable[[MethodResult], float]
Resampled = Callable[[MethodResult, IntArray], FloatArray]
"""A number of each draw (B,) of the pairs, which says how often each pair is in it (B, P)."""


@dataclass(frozen=True, slots=True)
class Column:
    """``key`` heads it in CSV, ``title`` on the page; ``definition`` is a sentence or two of the glossary.

    ``better`` is 1 where more is better, -1 where less is, 0 where it is neither. ``value`` computes it, and
    ``deviation``, where there is one, its standard deviation over the repeats, and ``resampled`` its values of draws of the
    pairs, for intervals. ``count``: whole numbers are shown without decimals.
    """

    key: str
    title: str
    definition: str
    digits: int
    better: int
    value: Number
    deviation: Number | None = None
    count: bool = False
    resampled: Resampled | None = None

    def text(self, value: float) -> str:
        """A value of this column as people read it, see `text_of`."""
        return text_of(value, 0 if self.count and float(value).is_integer() else self.digits)


def text_of(value: float, digits: int) -> str:
    """A value as people read it: ``never`` for what is infinite, a dash for what is undefined."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.{digits}f}"
