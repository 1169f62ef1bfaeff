import numpy as np
import pytest
from simulated_pairs import conditional_by_bisection

from sips_lit.detect.shared_effect import (
    NODES,
    WEIGHTS,
    conditional_logits,
    conditional_probabilities,
    log_likelihood,
    logit,
    sigmoid,
)

PROBABILITIES = np.array([1e-6, 0.003, 0.1, 0.5, 0.77, 0.98, 1 - 1e-6])


def test_weights_are_those_of_a_standard_normal():
    assert WEIGHTS.sum() == pytest.approx(1)
    assert pytest.approx(0) == WEIGHTS @ NODES
    assert pytest.approx(1, abs=1e-4) == WEIGHTS @ NODES**2


@pytest.mark.parametrize("deviation", [0.0, 0.3, 1.0, 2.5, 4.0])
def test_the_mean_over_the_effect_is_the_probability(deviation):
    given = conditional_probabilities(PROBABILITIES, deviation)
    assert given.shape == (len(PROBABILITIES), len(NODES))
    np.testing.assert_allclose(given @ WEIGHTS, PROBABILITIES, rtol=1e-3, atol=1e-7)
    assert (np.diff(given, axis=1) >= 0).all()
    assert (np.diff(given, axis=0) > 0).all()


@pytest.mark.parametrize("deviation", [0.5, 1.0, 2.0])
def test_the_same_as_by_halving(deviation):
    found = conditional_logits(logit(PROBABILITIES), deviation)
    expected = [conditional_by_bisection(p, deviation) for p in PROBABILITIES]
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_certain_points_stay_certain():
    given = conditional_probabilities(np.array([0.0, 1.0]), 1.0)
    assert given[0].max() < 1e-9
    assert given[1].min() > 1 - 1e-9


def test_no_points():
    assert conditional_probabilities(np.zeros(0), 1.0).shape == (0, len(NODES))


def test_likelihood_against_draws():
    generator = np.random.default_rng(1)
    delta, inlier = np.array([1.0, 0.2, -0.5, -1.0]), np.array([True, True, False, True])
    z = generator.normal(size=400_000)
    p = sigmoid(delta[:, None] + 1.3 * z)
    by_draws = np.log(np.where(inlier[:, None], p, 1 - p).prod(0).mean())
    assert log_likelihood(delta, inlier, 1.3) == pytest.approx(by_draws, abs=0.01)


def test_likelihood_without_an_effect_is_that_of_independent_points():
    delta, inlier = np.array([1.0, -0.5]), np.array([True, False])
    expected = np.log(sigmoid(1.0)) + np.log(1 - sigmoid(-0.5))
    assert log_likelihood(delta, inlier, 0.0) == pytest.approx(float(expected))


def test_a_likelihood_of_many_points_is_not_missed_between_the_nodes():
    """Narrow in z: 200 points tell the effect to 0.09."""
    generator = np.random.default_rng(2)
    delta = np.zeros(200)
    inlier = generator.random(200) < sigmoid(2 * 0.7)
    fine = np.linspace(-8, 8, 16001)
    each = inlier.sum() * 2 * fine - 200 * np.logaddexp(0, 2 * fine) - fine**2 / 2
    exact = np.logaddexp.reduce(each) + np.log(fine[1] - fine[0]) - 0.5 * np.log(2 * np.pi)
    assert log_likelihood(delta, inlier, 2.0) == pytest.approx(exact, abs=0.01)


def test_logit_and_sigmoid_are_inverse_and_bounded():
    np.testing.assert_allclose(sigmoid(logit(PROBABILITIES)), PROBABILITIES, rtol=1e-9)
    np.testing.assert_array_equal(logit([0.0, 1.0]), [-30, 30])
    np.testing.assert_array_equal(sigmoid([-1e4, 1e4]), [0, 1])
    np.testing.assert_allclose(sigmoid([-40.0, -300.0]), np.exp([-40.0, -300.0]), rtol=1e-12)
