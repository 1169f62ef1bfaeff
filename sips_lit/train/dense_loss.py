"""Losses of a network that learns the dense output of another: both from logits of every pixel."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor


def soft_target_loss(logits: Tensor, target: Tensor, known: Tensor, emphasis: float = 20.0) -> Tensor:
    """Mean over the ``known`` pixels of (1 + emphasis p) times the cross-entropy of sigmoid(logits) with p.

    p = sigmoid(target); all inputs have one shape. Points are rare: without ``emphasis`` the many pixels that are none would
    decide (20: our choice, from trials). Smallest, but not zero, where ``logits`` equal ``target``. Zero for no pixel.
    """
    p = torch.sigmoid(target)
    losses = (1 + emphasis * p) * F.binary_cross_entropy_with_logits(logits, p, reduction="none")
    return _mean(losses, known)


def logit_loss(logits: Tensor, target: Tensor, known: Tensor, bound: float = 8.0) -> Tensor:
    """Mean over the ``known`` pixels of p = sigmoid(target) times the smooth L1 distance of both logits, cut to +-``bound``.

    Cross-entropy is flat where both are sure; this keeps the order of the best points there (our choice, from trials).
    """
    distance = F.smooth_l1_loss(logits.clamp(-bound, bound), target.clamp(-bound, bound), reduction="none")
    return _mean(torch.sigmoid(target) * distance, known)


def _mean(losses: Tensor, known: Tensor) -> Tensor:
    return (losses * known).sum() / known.sum().clamp(min=1)
