import runpy
import sys

import numpy as np
import pytest
from cli_runs import ROOT
from textured_scenes import film

from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import PairChoice, PairSampler


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    yield runpy.run_path(str(ROOT / "benchmarks" / "shared_steps.py"))
    sys.modules.pop("label_time", None)


@pytest.mark.parametrize(
    ("choices", "share"),
    [
        ([PairChoice(0, 0, 4), PairChoice(0, 4, 6)], 0),
        ([PairChoice(0, 0, 4), PairChoice(0, 4, 0)], 1 / 2),
        ([PairChoice(0, 0, 4), PairChoice(1, 0, 4)], 0),
        ([PairChoice(0, 2, 6), PairChoice(0, 3, 5), PairChoice(0, 5, 2)], 5 / 9),
    ],
    ids=["side by side", "back", "other sequence", "within"],
)
def test_steps_of_two_pairs_are_saved_once(script, choices, share):
    assert script["saved"](choices) == pytest.approx(share)


def test_more_pairs_of_a_short_film_share_more(script, tmp_path):
    sampler = PairSampler(build_indexes([film(8)], tmp_path, OverlapParameters(), 1), 0.1, 0)
    two, eight = (script["mean_saved"](sampler, pairs) for pairs in (2, 8))
    assert 0 < two < eight < 1


def test_each_number_of_points_is_searched_for(script):
    noise = np.random.default_rng(0).integers(0, 256, (120, 160), np.uint8)
    rows = script["search_times"](noise, np.roll(noise, 2, axis=1))
    assert [row[0] for row in rows] == [70, 250, 500]
    assert all(row[1] > 0 < row[2] for row in rows)
