"""Averaged weights: what is validated and saved is the mean of the weights over the last steps."""

from __future__ import annotations

from functools import partial

from lightning.pytorch.callbacks import WeightAveraging
from torch import Tensor

from sips_lit.errors import BadInputError

QUARTER = 4
"""The mean reaches over a quarter of the steps so far at most: what the first ones leave behind is soon forgotten."""


class AveragedWeights(WeightAveraging):
    """Validates and saves an exponential mean of the weights over about the last ``steps`` steps.

    With a constant learning rate it takes the place of a rate that falls: where single pairs push the weights cancels out,
    so seeds differ less on kinds of data never seen (docs: results), and a run may end at any step. After n steps the mean
    reaches over n / 4 of them until that is ``steps`` (our choice). A checkpoint holds both: the mean as its weights, and
    where the optimiser is.

    Raises BadInputError for ``steps`` below 1.
    """

    def __init__(self, steps: int = 100) -> None:
        if steps < 1:
            raise BadInputError(
                f"callbacks.average.steps counts steps, from 1, and is {steps}; callbacks.average=null: none"
            )
        super().__init__(avg_fn=partial(mean_over, steps))


def mean_over(steps: int, mean: Tensor, current: Tensor, averaged: Tensor | int) -> Tensor:
    """The mean after another step, of which ``averaged`` are in it already."""
    reach = min(float(steps), 1 + float(averaged) / QUARTER)
    return mean + (current - mean) / reach
