"""Training pairs that were left out because something of them can't be read."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from tqdm import tqdm

from sips_lit.errors import BadInputError

TRUSTED = 50  # pairs left out before their share counts


class SkippedPairs:
    """Counts the pairs that a run left out; warns of the first, and refuses to go on with less than half of the pairs."""

    def __init__(self) -> None:
        self.count, self.first = 0, ""

    def add(self, reasons: Sequence[str], pairs: int) -> None:
        """Counts pairs left out, one reason each, before pair number ``pairs`` (from 1) of a run.

        Raises BadInputError when more than half of all pairs can't be read.
        """
        if reasons and not self.count:
            self.first = reasons[0]
            tqdm.write(f"warning: a training pair is left out, and others may be: {self.first}", file=sys.stderr)
        self.count += len(reasons)
        if self.count >= TRUSTED and self.count > pairs:
            raise BadInputError(
                f"{self.count} of the first {self.count + pairs} training pairs can't be read; the first: {self.first}"
            )

    def __str__(self) -> str:
        return f"{self.count} training pairs were left out; the first: {self.first}"

    def state_dict(self) -> dict[str, Any]:
        """Plain values, as a checkpoint may hold."""
        return {"count": self.count, "first": self.first}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Goes on counting."""
        self.count, self.first = state["count"], state["first"]
