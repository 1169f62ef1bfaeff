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


def constant_loss(rate: float) -> float:
    """Mean loss of always predicting the fraction ``rate`` of the points that are inliers: their entropy in nats."""
    return sum(-p * math.log(p) for p in (rate, 1 - rate) if p > 0)
