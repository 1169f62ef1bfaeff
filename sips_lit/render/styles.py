"""One style for each detector in all figures of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from sips_lit.render.figure import LINE_COLOURS

CONTROLS: Final = {"random": "#666666", "grid": "#9e9e9e"}
"""Greys of the detectors that ignore the image."""
_MARKERS: Final = ("", "o", "s", "^", "D")


@dataclass(frozen=True, slots=True)
class Style:
    """``index`` numbers the detectors of a report; ``colour``, ``line`` and ``marker`` as matplotlib has them."""

    index: int
    colour: str
    line: str
    marker: str


def detector_styles(names: Iterable[str], originals: Mapping[str, str] | None = None) -> dict[str, Style]:
    """A style for each different name, in this order; ``originals``: what those are called otherwise that a user named.

    ``SIFT`` and ``SIFT + RootSIFT`` have one colour; with a descriptor that others use too the line is solid, with the
    detector's own it is dashed. After seven detectors the colours come again with a marker. Controls are grey and dotted.
    """
    styles: dict[str, Style] = {}
    bases: list[str] = []
    for name in dict.fromkeys(names):
        original = (originals or {}).get(name, name)
        detector, shared, descriptor = original.rpartition(" + ")
        base = name.removesuffix(f" + {descriptor}") if shared else name
        control = next((each.lower() for each in (base, detector or original) if each.lower() in CONTROLS), None)
        if control is not None:
            styles[name] = Style(len(styles), CONTROLS[control], ":", "")
            continue
        if base not in bases:
            bases.append(base)
        around, colour = divmod(bases.index(base), len(LINE_COLOURS))
        line, marker = "-" if shared else "--", _MARKERS[around % len(_MARKERS)]
        styles[name] = Style(len(styles), LINE_COLOURS[colour], line, marker)
    return styles


def is_control(name: str) -> bool:
    """Whether a detector, by its name, ignores the image."""
    return name.partition(" + ")[0].lower() in CONTROLS


def literal(name: str) -> str:
    """A name as matplotlib shows it unchanged: a pair of dollars would be a formula, a leading underscore no label."""
    text = name.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text
