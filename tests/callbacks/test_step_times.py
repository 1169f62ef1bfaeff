from dataclasses import replace
from types import SimpleNamespace

import pytest
from train_run import fit, make_data, make_module
from validation_pairs import Module

from sips_lit.callbacks.step_times import WARM_UP, StepTimes
from sips_lit.train.loader import LabelledPair
from sips_lit.train.step_times import STEP, WORKERS


def step(callback, at: list[float], times: tuple[float, float, float], batch) -> dict[str, float]:
    """A pair that starts, ends its forward pass and ends at these times."""
    module = Module()
    at[0] = times[0]
    callback.on_train_batch_start(None, module, batch, 0)
    at[0] = times[1]
    callback.on_before_backward(None, module, None)
    at[0] = times[2]
    callback.on_train_batch_end(None, module, None, batch, 0)
    return module.logged


def labelled(**seconds: float) -> LabelledPair:
    return LabelledPair(*[None] * 7, 0, "pair", seconds=seconds)


def test_times_of_a_pair_in_milliseconds_and_their_means_after_the_first_pairs():
    at = [0.0]
    callback = StepTimes(lambda: at[0])
    callback.on_train_start(None, None)
    for _ in range(WARM_UP):
        step(callback, at, (0, 50, 100), labelled(decode=70.0))
    assert callback.told(2, 2) is None
    logged = step(callback, at, (200.0, 200.25, 201.0), labelled(track=0.5, wait_labels=0.5))
    assert logged == pytest.approx(
        {"time/forward": 250, "time/backward": 750, "time/track": 500, "time/wait_labels": 500}
    )
    step(callback, at, (300.0, 300.25, 300.5), labelled(track=0.5))
    assert callback.told(2, 2).startswith(
        "1000 ms a pair (backward 50%, waiting for labels 25%, forward 25%): the network waits"
    )


def test_a_batch_without_labels_was_waited_for_since_the_one_before_unless_there_was_a_validation():
    at = [0.0]
    callback = StepTimes(lambda: at[0])
    callback.on_train_start(None, None)
    batch = SimpleNamespace()
    assert "time/wait_decode" not in step(callback, at, (0, 1, 2), batch)
    assert step(callback, at, (5, 6, 7), batch)["time/wait_decode"] == 3000
    callback.on_validation_end(None, None)
    assert "time/wait_decode" not in step(callback, at, (90, 91, 92), batch)


@pytest.mark.parametrize(("loading", "labelling"), [(0, 1), (1, 2)])
def test_a_training_measures_every_stage(tmp_path, loading, labelling):
    callback = StepTimes()
    data = make_data(tmp_path, loading_workers=loading, labelling_workers=labelling)
    fit(make_module(), data, steps=4, callbacks=[callback])
    assert callback.pairs == 4 - WARM_UP
    assert set(callback.total.seconds) == {*STEP, *WORKERS}
    assert all(0 <= seconds < 60 for seconds in callback.total.seconds.values())
    assert callback.total.seconds["track"] > 0
    assert "ms a pair" in callback.told(loading, labelling)


def test_times_are_no_part_of_what_a_pair_is():
    assert replace(labelled(), seconds={"track": 1.0}) == labelled()
