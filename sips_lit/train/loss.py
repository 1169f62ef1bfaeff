"""The sparse inlierness loss (paper, loss section)."""

from __future__ import annotations

import math

import torch.nn.functional as F
from torch import Tensor


def inlierness_loss(logits: Tensor, inlier: Tensor, known: Tensor) -> Tensor:
    """Sum of -log P at inliers and -log(1 - P) at all other selected points, P = sigmoid(logit); all inputs (N,).

    Points whose truth is not known are ignored. Zero for no points. Computed on logits: no P can make it infinite.
    """
    losses = F.binary_cross_entropy_with_logits(logits, inlier.to(logits.dtype), reduction="none")
    return (losses * known).sum()


def consistency_loss(logits0: Tensor, logits1: Tensor, beta: float = 0.5) -> Tensor:
    """Sum of the smooth L1 distances of logits (M,) of both points of M inlier matches, quadratic below ``beta`` (ours).

    Points of one place of the scene shall rank alike in every image: a match counts only where both are selected.
    """
    return F.smooth_l1_loss(logits0, logits1, reduction="sum", beta=beta)


def constant_loss(rate: float) -> float:
    """Mean loss of always predicting the fraction ``rate`` of the points that are inliers: their entropy in nats."""
    return sum(-p * math.log(p) for p in (rate, 1 - rate) if p > 0)
