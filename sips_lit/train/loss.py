"""The sparse inlierness loss (paper, loss section)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

BUDGETS = (10, 20, 40, 80)  # points an image


def inlierness_loss(logits: Tensor, inlier: Tensor, known: Tensor) -> Tensor:
    """Sum of -log P at inliers and -log(1 - P) at all other selected points, P = sigmoid(logit); all inputs (N,).

    An inlier to some degree has its share of both. Points whose truth is not known are ignored. Zero for no points.
    Computed on logits: no P can make it infinite.
    """
    losses = F.binary_cross_entropy_with_logits(logits, inlier.to(logits.dtype), reduction="none")
    return (losses * known).sum()


def consistency_loss(logits0: Tensor, logits1: Tensor, beta: float = 0.5) -> Tensor:
    """Sum of the smooth L1 distances of logits (M,) of both points of M inlier matches, quadratic below ``beta`` (ours).

    Points of one place of the scene shall rank alike in every image: a match counts only where both are selected.
    """
    return F.smooth_l1_loss(logits0, logits1, reduction="sum", beta=beta)


def ranking_loss(
    logits0: Tensor, logits1: Tensor, index0: Tensor, index1: Tensor, last: Tensor, budgets: Sequence[int] = BUDGETS
) -> Tensor:
    """How far the inliers among the n best points fall short of n, on average over the budgets n that leave a choice.

    ``logits0`` and ``logits1`` (N,) are those of the points of both images; ``index0`` and ``index1`` (M,) the ends of the
    inlier matches, ``last`` (M,) the most points among which they are matches. A match counts as far as both ends are
    among the n best: by a sigmoid of how far the logit is above a threshold that lets n points pass. Between 0 and 1;
    zero where there are fewer points than in any budget. Our choice: the inliers of n points are what succinctness counts.
    """
    budgets = [n for n in budgets if n < min(len(logits0), len(logits1))]
    if not budgets:
        return (logits0.sum() + logits1.sum()) * 0
    n = torch.tensor(budgets, dtype=logits0.dtype, device=logits0.device)
    chosen0, chosen1 = soft_choice(logits0, n), soft_choice(logits1, n)
    inliers = (chosen0[:, index0] * chosen1[:, index1] * (last >= n[:, None])).sum(1)
    return (1 - inliers / n).mean()


def soft_choice(logits: Tensor, n: Tensor, steps: int = 30) -> Tensor:
    """How far each of N points is among the n best, for B budgets ``n`` (B,): (B, N) between 0 and 1, with sum n.

    The sigmoid of the logit above a threshold, which is found by bisection; its gradient follows from the sum.
    """
    with torch.no_grad():
        low, high = (logits.min() - 20).expand(len(n)).clone(), (logits.max() + 20).expand(len(n)).clone()
        for _ in range(steps):
            middle = (low + high) / 2
            many = torch.sigmoid(logits - middle[:, None]).sum(1) > n
            low, high = torch.where(many, middle, low), torch.where(many, high, middle)
        slope = torch.sigmoid(logits - low[:, None])
        slope = slope * (1 - slope)
    follows = (slope * (logits - logits.detach())).sum(1) / slope.sum(1)  # zero, with the gradient of the threshold
    return torch.sigmoid(logits - (low + follows)[:, None])


def constant_loss(rate: float) -> float:
    """Mean loss of always predicting the fraction ``rate`` of the points that are inliers: their entropy in nats."""
    return sum(-p * math.log(p) for p in (rate, 1 - rate) if p > 0)
