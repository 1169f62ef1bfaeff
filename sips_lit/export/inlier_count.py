"""How many of the best points an exported graph keeps: `Budget.keep` on batches."""

from __future__ import annotations

import itertools

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.detect.budget import Budget
from sips_lit.detect.recalibration import REFERENCE_POINTS, Recalibration
from sips_lit.detect.shared_effect import NODES, WEIGHTS, conditional_probabilities, logit, sigmoid

MOST_TRIED = 15
"""Numbers of points that a round of the search tries; each round is a copy of the computation in the graph."""
MOST_LOGIT = 15.0
"""Beyond it a probability is 0 or 1 for a number of inliers."""
STEPS = 3001
"""Of the table of conditional logits: what lies between two of them is linear to 1e-6."""


def recalibrated(logits: Tensor, recalibration: Recalibration, kept: Tensor) -> Tensor:
    """Logits of the probabilities that come true where ``kept`` points are kept, of those of the network."""
    shift = recalibration.log_n * torch.log(kept.clamp(min=1).to(logits.dtype) / REFERENCE_POINTS)
    return recalibration.scale * logits + recalibration.offset + shift


def points_to_keep(
    logits: Tensor, found: Tensor, budget: Budget, recalibration: Recalibration
) -> tuple[Tensor, Tensor | None]:
    """How many of the points to keep (B,) int64, and with k whether they are enough for it (B,) bool.

    ``logits`` (B, N): the network's, best first, of which the first ``found`` (B,) are points; N is `Budget.candidates`.
    """
    counts = torch.arange(1, logits.shape[1] + 1, device=logits.device)
    allowed = counts <= found[:, None]
    if budget.threshold is not None:
        last = torch.sigmoid(recalibrated(logits, recalibration, counts))
        allowed = allowed & (last >= budget.threshold)
    most = torch.where(allowed, counts, 0).amax(1)
    if budget.k is None:
        return most, None
    needed = smallest_count(logits, most, budget, recalibration)
    reached = torch.where(allowed & (counts >= needed[:, None]), counts, logits.shape[1]).amin(1)
    return torch.minimum(reached, most), needed <= most


def smallest_count(logits: Tensor, most: Tensor, budget: Budget, recalibration: Recalibration) -> Tensor:
    """`smallest_budget` (B,) of the first ``most`` (B,) points; ``most`` + 1 where there is none.

    More points give more inliers, so each round tries a few numbers, equally spaced, and goes on between two of them.
    """
    answers = logits.shape[1] + 1
    rounds = next(r for r in itertools.count(1) if (MOST_TRIED + 1) ** r >= answers)
    tried = next(t for t in itertools.count(1) if (t + 1) ** rounds >= answers)
    part = torch.arange(1, tried + 1, device=logits.device)
    low, high = torch.ones_like(most), most + 1  # the smallest number is one of low, ..., high
    for _ in range(rounds):
        counts = low[:, None] - 1 + (high - low + 1)[:, None] * part // (tried + 1)
        enough = probability_of_k(logits, counts, budget, recalibration) >= budget.confidence
        low = torch.maximum(low, torch.where(enough, 0, counts + 1).amax(1))
        high = torch.minimum(high, torch.where(enough, counts, logits.shape[1] + 1).amin(1))
    return high


def probability_of_k(logits: Tensor, counts: Tensor, budget: Budget, recalibration: Recalibration) -> Tensor:
    """P(at least k of the first ``counts`` (B, M) points are inliers) (B, M), when no others are kept."""
    assert budget.k is not None
    marginal = recalibrated(logits[:, None], recalibration, counts[..., None])
    given, weights = conditional_logits(marginal.clamp(-MOST_LOGIT, MOST_LOGIT), recalibration.difficulty)
    kept = torch.arange(logits.shape[1], device=logits.device) < counts[..., None]
    fewer = fewer_inliers(torch.where(kept[..., None], given, -torch.inf), budget.k)
    return 1 - (fewer * weights).sum(-1)


def conditional_logits(marginal: Tensor, difficulty: float) -> tuple[Tensor, Tensor]:
    """Logits of P(inlier | z) (..., N, Q) of points whose probabilities have the logits (..., N), and weights (Q,) of the z.

    Those of `conditional_probabilities`, from a table between plus and minus `MOST_LOGIT`.
    """
    if difficulty == 0:
        return marginal[..., None], marginal.new_ones(1)
    middle = conditional_probabilities(sigmoid(np.linspace(-MOST_LOGIT, MOST_LOGIT, STEPS)), difficulty)[
        :, len(NODES) // 2
    ]
    table = torch.from_numpy(logit(middle)).to(marginal)
    position = (marginal + MOST_LOGIT) * ((STEPS - 1) / (2 * MOST_LOGIT))
    below = position.long().clamp(max=STEPS - 2)
    delta = table[below] + (position - below) * (table[below + 1] - table[below])
    effect, weights = (torch.from_numpy(values).to(marginal) for values in (difficulty * NODES, WEIGHTS))
    return delta[..., None] + effect, weights


def fewer_inliers(logits: Tensor, k: int) -> Tensor:
    """P(fewer than ``k`` of N independent points are inliers) (..., Q), of the logits (..., N, Q) of their probabilities.

    The first k coefficients of the product of 1 - p + p x over the points, multiplied in pairs: log2(N) steps, all of whose
    terms are positive.
    """
    points = logits.shape[-2]
    logits = F.pad(logits, (0, 0, 0, (1 << (points - 1).bit_length()) - points), value=-torch.inf)
    factors = torch.sigmoid(torch.stack([-logits, logits], -3))[..., :k, :, :]
    while factors.shape[-2] > 1:
        factors = _product(factors[..., 0::2, :], factors[..., 1::2, :])[..., :k, :, :]
    return factors.sum((-3, -2))


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Coefficients (..., 2 C - 1, N, Q) of the products of N Q polynomials (..., C, N, Q)."""
    size = a.shape[-3]
    terms = a[..., :, None, :, :] * b[..., None, :, :, :]
    terms = F.pad(terms, (0, 0, 0, 0, 0, size)).flatten(-4, -3)  # a row for each coefficient of a
    # with one number less in each row, the next one begins a place further right
    shifted: Tensor = torch.unflatten(terms[..., :-size, :, :], -3, (size, 2 * size - 1))
    return shifted.sum(-4)
