import json

import numpy as np
import pytest

from sips_lit.train.source_focus import FAST, MOST, SLOW, LossOfSource, SourceFocus

ODDS = {"city": 3.0, "desk": 1.0, "snow": 0.5}


def learned(measure, losses, odds=ODDS) -> SourceFocus:
    """After steps of which each has a pair of every source; ``losses`` are those of each source over the steps."""
    focus = SourceFocus(measure, odds)
    for step in zip(*losses.values(), strict=True):
        focus.learn(dict(zip(losses, step, strict=True)))
    return focus


def on_average(focus, odds=ODDS) -> float:
    return sum(weight * focus[name] for name, weight in odds.items()) / sum(odds.values())


@pytest.mark.parametrize("measure", ["difficulty", "progress"])
def test_sources_weigh_as_configured_before_they_are_known(measure):
    losses = {name: [loss] * (FAST - 1) for name, loss in zip(ODDS, (0.2, 0.5, 0.9), strict=True)}
    focus = learned(measure, losses)
    assert [focus[name] for name in ODDS] == [1, 1, 1]


def test_difficulty_is_the_mean_loss():
    focus = learned("difficulty", {"city": [0.3] * 50, "desk": [0.6] * 50, "snow": [0.45] * 50})
    mean = (3 * 0.3 + 0.6 + 0.5 * 0.45) / 4.5
    assert [focus[name] for name in ODDS] == pytest.approx([0.3 / mean, 0.6 / mean, 0.45 / mean])


def test_progress_is_how_much_the_loss_changes_up_or_down():
    flat, falls, rises = np.full(60, 0.5), np.linspace(0.8, 0.2, 60), np.linspace(0.3, 0.6, 60)
    focus = learned("progress", {"city": flat, "desk": falls, "snow": rises})
    assert focus["city"] < 1 < focus["snow"] < focus["desk"]
    assert focus["city"] == pytest.approx(1 / MOST)  # a source that stands still is not given up
    assert on_average(focus) == pytest.approx(1)


def test_a_loss_that_jumps_is_progress_until_both_means_have_followed():
    jumps = np.r_[np.full(50, 0.9), np.full(5, 0.3)]
    later = np.r_[jumps, np.full(10 * SLOW, 0.3)]
    others = {"city": 0.5 + 0.01 * (-1.0) ** np.arange(len(later))}
    soon = learned("progress", {"city": others["city"][: len(jumps)], "desk": jumps}, {"city": 1.0, "desk": 1.0})
    late = learned("progress", {"city": others["city"], "desk": later}, {"city": 1.0, "desk": 1.0})
    assert soon["desk"] > 1.6
    assert late["desk"] < 0.5


@pytest.mark.parametrize("measure", ["difficulty", "progress"])
@pytest.mark.parametrize("spread", [0.1, 1, 3])
def test_the_factors_are_bounded_and_1_on_average_over_the_odds(measure, spread):
    rng = np.random.default_rng(0)
    odds = {f"source {i}": weight for i, weight in enumerate(rng.uniform(0.2, 4, 9))}
    means = np.exp(spread * rng.standard_normal(9))
    losses = {name: mean * rng.uniform(0.5, 1.5, 80) for name, mean in zip(odds, means, strict=True)}
    focus = learned(measure, losses, odds)
    factors = np.array([focus[name] for name in odds])
    assert on_average(focus, odds) == pytest.approx(1)
    assert factors.min() >= 1 / MOST
    assert factors.max() <= MOST
    inside = (factors > 1.001 / MOST) & (factors < 0.999 * MOST)
    if measure == "difficulty":
        assert inside.sum() > 1
        slow = np.array([focus.losses[name].slow for name in odds])
        ratio = factors[inside] / slow[inside]
        np.testing.assert_allclose(ratio, ratio[0])  # in proportion to the loss, where no bound is reached


def test_a_source_that_was_hardly_seen_counts_as_the_others_on_average():
    focus = SourceFocus("difficulty", ODDS)
    for step in range(50):
        focus.learn({"city": 0.2, "desk": 0.6} if step else {"city": 0.2, "desk": 0.6, "snow": 9.0})
    assert focus["snow"] == pytest.approx(1)
    assert focus["city"] < 1 < focus["desk"]


def test_a_single_source_weighs_as_configured():
    for measure in ("difficulty", "progress"):
        assert learned(measure, {"data": np.linspace(1, 0.2, 30)}, {"data": 2.5})["data"] == pytest.approx(1)


def test_sources_without_any_loss_or_change_weigh_as_configured():
    for measure in ("difficulty", "progress"):
        assert [learned(measure, dict.fromkeys(ODDS, [0.0] * 20))[name] for name in ODDS] == [1, 1, 1]


def test_a_stored_state_goes_on_exactly():
    rng = np.random.default_rng(3)
    steps = [{name: float(rng.random()) for name in ODDS if rng.random() < 0.7} for _ in range(90)]
    whole, first, second = (SourceFocus("progress", ODDS) for _ in range(3))
    for step in steps:
        whole.learn(step)
    for step in steps[:40]:
        first.learn(step)
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    assert [second[name] for name in ODDS] == [first[name] for name in ODDS]
    for step in steps[40:]:
        second.learn(step)
    assert [second[name] for name in ODDS] == [whole[name] for name in ODDS]
    assert len({whole[name] for name in ODDS}) == 3


def test_a_state_of_other_sources_begins_those_that_it_lacks():
    stored = learned("difficulty", {"city": [0.2] * 20, "desk": [0.4] * 20}, {"city": 1.0, "desk": 1.0}).state_dict()
    focus = SourceFocus("difficulty", {"city": 1.0, "snow": 1.0})
    focus.load_state_dict(stored)
    assert focus.losses["city"].steps == 20
    assert focus.losses["snow"].steps == 0


def test_the_first_losses_count_alike_and_later_ones_fade():
    loss = LossOfSource()
    for value in (1.0, 2.0, 6.0):
        loss.add(value)
    assert (loss.fast, loss.slow, loss.steps) == (pytest.approx(3), pytest.approx(3), 3)
    for _ in range(200):
        loss.add(1.0)
    loss.add(2.0)
    assert loss.fast == pytest.approx(1 + 1 / FAST, abs=1e-3)
    assert loss.slow == pytest.approx(1 + 1 / SLOW, abs=2e-2)
