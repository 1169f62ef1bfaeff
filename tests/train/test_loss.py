import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.train.loss import consistency_loss, constant_loss, inlierness_loss, ranking_loss, soft_choice

POINTS = st.lists(st.tuples(st.floats(-12, 12), st.booleans(), st.booleans()), max_size=20)


@given(POINTS)
@settings(max_examples=80, deadline=None)
def test_minus_log_of_the_probability_of_what_is_true(points):
    expected = 0.0
    for logit, inlier, known in points:
        p = 1 / (1 + np.exp(-logit))
        if known:
            expected += -np.log(p) if inlier else -np.log(1 - p)
    logits = torch.tensor([p[0] for p in points], dtype=torch.float64)
    inlier, known = (torch.tensor([p[i] for p in points], dtype=torch.bool) for i in (1, 2))
    assert float(inlierness_loss(logits, inlier, known)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_unknown_points_have_no_gradient():
    logits = torch.tensor([0.5, -2.0, 3.0], requires_grad=True)
    inlierness_loss(logits, torch.tensor([True, False, True]), torch.tensor([True, False, False])).backward()
    assert logits.grad.tolist() == [pytest.approx(1 / (1 + np.exp(-0.5)) - 1), 0, 0]


def test_no_points():
    none = torch.zeros(0, dtype=torch.bool)
    logits = torch.zeros(0, requires_grad=True)
    loss = inlierness_loss(logits, none, none)
    assert loss.item() == 0
    loss.backward()  # a pair without points is legal in training


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("inlier", [True, False])
def test_finite_for_any_logit(sign, inlier):
    logits = torch.tensor([sign * 1e4], requires_grad=True)
    loss = inlierness_loss(logits, torch.tensor([inlier]), torch.tensor([True]))
    loss.backward()
    assert loss.item() == (0 if (sign > 0) == inlier else 1e4)
    assert torch.isfinite(logits.grad).all()


def test_gradient():
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(12, dtype=torch.float64, generator=generator).mul(3).requires_grad_()
    inlier, known = torch.rand(12, generator=generator) < 0.4, torch.rand(12, generator=generator) < 0.8
    assert torch.autograd.gradcheck(lambda x: inlierness_loss(x, inlier, known), logits)


@pytest.mark.parametrize("rate", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_no_constant_prediction_is_better_than_the_rate(rate):
    inlier, known = torch.arange(100) < round(100 * rate), torch.ones(100, dtype=torch.bool)
    tried = torch.linspace(-20, 20, 4001, dtype=torch.float64)
    best = min(float(inlierness_loss(logit.expand(100), inlier, known)) / 100 for logit in tried)
    assert constant_loss(rate) == pytest.approx(best, abs=1e-5)


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=20))
@settings(max_examples=80, deadline=None)
def test_consistency_grows_with_the_square_of_a_small_difference_and_then_as_it(logits):
    expected = sum((a - b) ** 2 if abs(a - b) < 0.5 else abs(a - b) - 0.25 for a, b in logits)
    first, second = (torch.tensor([pair[side] for pair in logits], dtype=torch.float64) for side in (0, 1))
    assert float(consistency_loss(first, second)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("n", [1, 3.0, 7])
def test_a_soft_choice_of_n_points_adds_up_to_n_and_follows_the_logits(n):
    logits = torch.tensor([2.0, -1, 0.5, 4, 0.4, -3, 1, 1, 0, -0.2], dtype=torch.float64)
    chosen = soft_choice(logits, torch.tensor([n], dtype=torch.float64))[0]
    assert float(chosen.sum()) == pytest.approx(n, abs=1e-6)
    assert (np.argsort(chosen.numpy(), kind="stable") == np.argsort(logits.numpy(), kind="stable")).all()
    thresholds = logits - torch.logit(chosen)
    assert thresholds.numpy() == pytest.approx(float(thresholds[0]), abs=1e-6)  # the same one for all


def test_the_gradient_of_a_soft_choice_is_that_of_finite_differences():
    logits = torch.randn(12, generator=torch.Generator().manual_seed(0), dtype=torch.float64, requires_grad=True)
    budgets = torch.tensor([3, 5], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: soft_choice(x, budgets, steps=60), (logits,))


def test_sharp_logits_count_the_inliers_among_the_n_best_as_a_loop_does():
    generator = np.random.default_rng(3)
    logits0, logits1 = (generator.permutation(40) * 50.0 for _ in range(2))  # steps of 50: all choices are sharp
    index0, index1 = (generator.permutation(40)[:25] for _ in range(2))
    last = generator.choice([7, 15, 10**9], 25)  # the most points among which the match is one
    short = []
    for n in (5, 10, 20):
        best0, best1 = (set(np.argsort(-logits)[:n].tolist()) for logits in (logits0, logits1))
        short.append(
            1 - sum(i in best0 and j in best1 and n <= m for i, j, m in zip(index0, index1, last, strict=True)) / n
        )
    tensors = [torch.from_numpy(a) for a in (logits0, logits1, index0, index1, last)]
    assert float(ranking_loss(*tensors, budgets=(5, 10, 20, 40, 80))) == pytest.approx(np.mean(short), abs=1e-6)


def test_ranking_pulls_up_an_inlier_near_the_threshold_and_pushes_down_its_rival():
    logits = torch.tensor([0.2, 0.1, -3.0], requires_grad=True)
    ranking_loss(
        logits, logits.detach(), torch.tensor([1]), torch.tensor([1]), torch.tensor([3]), budgets=(1,)
    ).backward()
    assert logits.grad[1] < 0 < logits.grad[0]


def test_ranking_needs_more_points_than_the_budget():
    logits = torch.zeros(10, requires_grad=True)
    every = torch.arange(10)
    loss = ranking_loss(logits, logits, every, every, every + 10)
    loss.backward()
    assert loss.item() == 0
    assert not logits.grad.any()
