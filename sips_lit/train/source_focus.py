"""Weights of sources that follow the training: by how hard each is, or by how fast it is being learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Focus = Literal["difficulty", "progress"]

FAST: Final = 10
SLOW: Final = 40
"""Steps with a pair of the source over which its loss is averaged."""
MOST: Final = 3.0
"""What a source weighs is at most so many times as much, and as little, as what is configured."""


@dataclass(slots=True)
class LossOfSource:
    """The loss of a source, averaged over its last steps, few (``fast``) and many (``slow``); nats."""

    fast: float = 0.0
    slow: float = 0.0
    steps: int = 0

    def add(self, loss: float) -> None:
        """The loss of one more step; the first ones count alike."""
        self.steps += 1
        self.fast += (loss - self.fast) / min(self.steps, FAST)
        self.slow += (loss - self.slow) / min(self.steps, SLOW)


class SourceFocus:
    """What the loss of a pair counts by its source, so that sources weigh as if they were drawn with other odds.

    By ``difficulty`` in proportion to the mean loss of a point, by ``progress`` in proportion to how much that has
    changed of late, up or down: the slope of the learning curve, as Matiisen et al., "Teacher-student curriculum
    learning" (2017), choose tasks by. ``odds``: how likely a pair is of each source, by name, in any unit. The factors
    are 1 on average over these odds, and between 1 / `MOST` and `MOST`; a source that fewer than `FAST` steps had counts
    as the others do on average. That the loss is weighted and not the drawing (our choice) leaves every pair a function of
    the seed and its number.
    """

    def __init__(self, measure: Focus, odds: Mapping[str, float]) -> None:
        self.measure = measure
        self.odds = {name: weight / sum(odds.values()) for name, weight in odds.items()}
        self.losses = {name: LossOfSource() for name in odds}
        self._factors = dict.fromkeys(odds, 1.0)

    def __getitem__(self, source: str) -> float:
        """The factor of a source's pairs in the next step."""
        return self._factors[source]

    def learn(self, losses: Mapping[str, float]) -> None:
        """Takes the mean losses of one step's sources in; the factors change."""
        for source, loss in losses.items():
            self.losses[source].add(loss)
        known = {name: loss for name, loss in self.losses.items() if loss.steps >= FAST}
        values = {name: self._value(loss) for name, loss in known.items()}
        weight = sum(self.odds[name] for name in values)
        mean = sum(self.odds[name] * value for name, value in values.items()) / weight if values else 0.0
        wanted = {name: values.get(name, mean) / mean if mean > 0 else 1.0 for name in self.odds}
        self._factors = _bounded(wanted, self.odds)

    def _value(self, loss: LossOfSource) -> float:
        return loss.slow if self.measure == "difficulty" else abs(loss.fast - loss.slow)

    def state_dict(self) -> dict[str, Any]:
        """Plain values, as a checkpoint may hold."""
        return {name: [loss.fast, loss.slow, loss.steps] for name, loss in self.losses.items()}

    def load_state_dict(self, state: Mapping[str, Sequence[Any]]) -> None:
        """Goes on; sources that the state has not, begin."""
        for name, (fast, slow, steps) in state.items():
            if name in self.losses:
                self.losses[name] = LossOfSource(fast, slow, steps)
        self.learn({})


def _bounded(factors: Mapping[str, float], odds: Mapping[str, float]) -> dict[str, float]:
    """The factors times a common one, within `MOST`, whose mean over the odds is 1: the common one by bisection."""
    wanted, weights = np.array([factors[name] for name in odds]), np.array(list(odds.values()))

    def scaled(doublings: float) -> NDArray[np.float64]:
        return np.clip(wanted * 2**doublings, 1 / MOST, MOST)

    low, high = -30.0, 30.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if weights @ scaled(middle) < 1 else (low, middle)
    return dict(zip(odds, scaled(high).tolist(), strict=True))
