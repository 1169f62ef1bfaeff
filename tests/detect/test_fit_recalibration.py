import numpy as np
import pytest
from simulated_pairs import simulate

from sips_lit.detect.budget import smallest_budget
from sips_lit.detect.fit_recalibration import PointGroup, fit_difficulty, fit_recalibration
from sips_lit.detect.recalibration import Recalibration
from sips_lit.errors import BadInputError

TRUTH = Recalibration(0.6, -0.7, 0.3, 1.2)


def test_a_known_truth_is_found():
    found = fit_recalibration(simulate(TRUTH, 400, (25, 50, 100), 0))
    assert found.scale == pytest.approx(TRUTH.scale, abs=0.05)
    assert found.offset == pytest.approx(TRUTH.offset, abs=0.1)
    assert found.log_n == pytest.approx(TRUTH.log_n, abs=0.12)
    assert found.difficulty == pytest.approx(TRUTH.difficulty, abs=0.12)


def test_independent_points_have_no_difficulty():
    found = fit_recalibration(simulate(Recalibration(1.5, 0.4), 150, (25, 50), 1))
    assert found.difficulty < 0.2
    assert found.scale == pytest.approx(1.5, abs=0.1)


def test_one_budget_says_nothing_of_n():
    assert fit_recalibration(simulate(TRUTH, 60, (50,), 2)).log_n == 0


def test_inliers_that_get_rarer_with_n_are_no_shift():
    groups = simulate(Recalibration(0.8), 60, (25, 100), 3)
    fewer = [
        PointGroup(g.logit, g.inlier & (np.arange(len(g.logit)) % 2 == 0) if g.n == 100 else g.inlier, g.n)
        for g in groups
    ]
    assert fit_recalibration(fewer).log_n == 0


def test_difficulty_is_where_the_likelihood_is_greatest():
    groups = simulate(TRUTH, 60, (50,), 4)
    found = fit_difficulty(groups, Recalibration(TRUTH.scale, TRUTH.offset))
    assert 0.7 < found < 1.8


def test_promises_of_k_inliers_hold_where_those_of_independent_points_do_not():
    """Coverage in pairs that nothing was fitted to, by drawing them."""
    truth = Recalibration(0.7, -1.5, 0.0, 1.5)
    found = fit_recalibration(simulate(truth, 200, (100,), 5))
    fresh = simulate(truth, 600, (100,), 6)
    observed = {}
    for name, difficulty in (("shared", found.difficulty), ("independent", 0.0)):
        recalibration = Recalibration(found.scale, found.offset, found.log_n, difficulty)
        hits = []
        for group in fresh:
            n = smallest_budget(group.probability(recalibration), 8, 0.8, recalibration)
            if n is not None:
                hits.append(group.inlier[:n].sum() >= 8)
        assert len(hits) > 560
        observed[name] = np.mean(hits)
    assert observed["shared"] == pytest.approx(0.8, abs=0.05)
    assert observed["independent"] < 0.72


def test_few_points_are_drawn_to_no_change():
    group = PointGroup(np.array([2.0, -2.0]), np.array([True, False]), 2)
    found = fit_recalibration([group])
    assert 0.5 < found.scale < 3


@pytest.mark.parametrize("inlier", [True, False])
def test_all_alike(inlier):
    with pytest.raises(BadInputError, match="of the 5 points to fit to are inliers"):
        fit_recalibration([PointGroup(np.arange(5.0), np.full(5, inlier), 5)])


def test_nothing_at_all():
    with pytest.raises(BadInputError, match="0 of the 0 points"):
        fit_recalibration([PointGroup(np.zeros(0), np.zeros(0, bool), 50)])


def test_scores_that_mislead():
    groups = [PointGroup(-g.logit, g.inlier, g.n) for g in simulate(Recalibration(2.0), 30, (50,), 7)]
    with pytest.raises(BadInputError, match="better scores are not more often inliers"):
        fit_recalibration(groups)
