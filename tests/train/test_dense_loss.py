import math

import pytest
import torch

from sips_lit.train.dense_loss import logit_loss, soft_target_loss


def logits(seed: int, dtype=torch.float64) -> torch.Tensor:
    return 4 * torch.randn(2, 1, 5, 6, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def some(seed: int = 2) -> torch.Tensor:
    return torch.rand(2, 1, 5, 6, generator=torch.Generator().manual_seed(seed)) < 0.7


def slow_mean(student, teacher, known, of_pixel) -> float:
    pairs = zip(student.flatten().tolist(), teacher.flatten().tolist(), known.flatten().tolist(), strict=True)
    losses = [of_pixel(a, b) for a, b, counts in pairs if counts]
    return sum(losses) / len(losses)


@pytest.mark.parametrize("emphasis", [0, 20])
def test_the_cross_entropy_is_its_plain_definition(emphasis):
    def of_pixel(a: float, b: float) -> float:
        q, p = 1 / (1 + math.exp(-a)), 1 / (1 + math.exp(-b))
        return -(1 + emphasis * p) * (p * math.log(q) + (1 - p) * math.log(1 - q))

    expected = slow_mean(logits(0), logits(1), some(), of_pixel)
    assert float(soft_target_loss(logits(0), logits(1), some(), emphasis)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("bound", [1.0, 3.0, 50.0])
def test_the_distance_of_logits_is_its_plain_definition(bound):
    def of_pixel(a: float, b: float) -> float:
        d = abs(min(max(a, -bound), bound) - min(max(b, -bound), bound))
        return (d * d / 2 if d < 1 else d - 0.5) / (1 + math.exp(-b))

    expected = slow_mean(logits(0), logits(1), some(), of_pixel)
    assert float(logit_loss(logits(0), logits(1), some(), bound)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("loss", [soft_target_loss, logit_loss])
def test_gradients(loss):
    student = logits(0).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: loss(x, logits(1), some()), student)
    loss(student, logits(1), some()).backward()
    assert not student.grad[~some()].any()


def test_the_teacher_itself_is_the_minimum():
    teacher = logits(1).requires_grad_()
    floor = soft_target_loss(teacher, teacher.detach(), some())
    (gradient,) = torch.autograd.grad(floor, teacher)
    assert gradient.abs().max() < 1e-12
    assert logit_loss(teacher, teacher, some()) == 0
    for seed in range(5):
        assert soft_target_loss(teacher + 0.1 * logits(seed), teacher, some()) > floor


@pytest.mark.parametrize("loss", [soft_target_loss, logit_loss])
def test_no_pixel_and_logits_beyond_all_bounds(loss):
    assert loss(logits(0), logits(1), torch.zeros(2, 1, 5, 6, dtype=torch.bool)) == 0
    far = torch.tensor([[1e4, -1e4, 1e4, -1e4]])
    assert torch.isfinite(loss(far, far.flip(1), torch.ones(1, 4, dtype=torch.bool)))
