from functools import partial

import lightning as L
import numpy as np
import pytest
import torch
from train_run import fit, make_data, make_module

from sips_lit.callbacks.averaging import AveragedWeights, mean_over
from sips_lit.errors import BadInputError


class Biases(L.Callback):
    """The last layer's bias where the optimiser is, after each of its steps, and when validations see it."""

    def __init__(self) -> None:
        self.stepped: list[float] = []
        self.validated: list[float] = []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        if trainer.global_step > len(self.stepped):
            self.stepped.append(float(pl_module.network.layers[-1].bias))

    def on_validation_batch_start(self, trainer, pl_module, batch, batch_idx, dataloader_idx=0) -> None:
        self.validated.append(float(pl_module.network.layers[-1].bias))


def expected_mean(values: list[float], steps: int) -> float:
    mean = values[0]
    for index, value in enumerate(values[1:], 1):
        reach = min(steps, 1 + index / 4)
        mean = (1 - 1 / reach) * mean + value / reach
    return mean


@pytest.mark.parametrize("steps", [1, 2, 100])
@pytest.mark.parametrize("pairs", [1, 2])
def test_what_is_validated_and_left_is_the_mean_of_the_weights_of_steps(tmp_path, steps, pairs):
    module, seen = make_module(optimizer=partial(torch.optim.SGD, lr=1e-3)), Biases()
    callbacks = [AveragedWeights(steps), seen]
    trainer = fit(module, make_data(tmp_path), steps=8, callbacks=callbacks, accumulate_grad_batches=pairs)
    assert trainer.global_step == len(seen.stepped) == len(set(seen.stepped)) == 8
    mean = expected_mean(seen.stepped, steps)
    assert float(module.network.layers[-1].bias.detach()) == pytest.approx(mean, abs=1e-6)
    assert seen.validated[-1] == pytest.approx(mean, abs=1e-6)
    assert (abs(mean - seen.stepped[-1]) > 1e-6) == (steps > 1)


def test_a_long_run_averages_over_about_so_many_steps():
    """Of a step that was 100 steps ago the share is 1 / e of that of the last one; of 1000 ago it is nothing."""
    shares = np.zeros(2000)
    for index in range(len(shares)):
        reach = 1 if index == 0 else min(100, 1 + index / 4)
        shares *= 1 - 1 / reach
        shares[index] = 1 / reach
    mean = torch.zeros(len(shares))
    mean[0] = 1
    for index in range(1, len(shares)):
        one = torch.zeros(len(shares))
        one[index] = 1
        mean = mean_over(100, mean, one, index)
    np.testing.assert_allclose(mean, shares, atol=1e-6)
    assert shares[-101] / shares[-1] == pytest.approx(np.exp(-1), rel=0.02)
    assert shares[:900].sum() < 1e-4


@pytest.mark.parametrize("steps", [0, -1])
def test_it_counts_steps(steps):
    with pytest.raises(BadInputError, match=r"callbacks\.average\.steps counts steps, from 1"):
        AveragedWeights(steps)
