"""Succinctness: how many points must be extracted to get k inlier matches (Cieslewski et al., 3DV 2019, section 3).

Of a pair of images, inliers(n) is the number of inliers among the matches between the n best points of both, and n_k
the smallest n with inliers(n) >= k. A pair that gets there with no n up to n_max is a failure. Over many pairs s(n) is
the fraction whose n_k is at most n, and AUC its mean over n in [0, n_max): at best, n_k = k everywhere, 1 - k / n_max.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics import Metric

from sips_lit.inliers.verifier import points_needed


@dataclass(frozen=True, slots=True)
class SuccinctnessResult:
    """Succinctness over ``pairs`` image pairs.

    ``curve`` (n_max + 1,) float64 is s(n) for n = 0 … n_max; ``auc`` its mean over [0, n_max); ``n_at_80`` and
    ``median`` are the smallest n at which 80 % and half of the pairs have succeeded, None if they never do;
    ``failures`` counts the pairs without k inliers at any n. Of no pairs at all, ``auc`` and ``curve`` are NaN.
    """

    auc: float
    n_at_80: int | None
    median: int | None
    failures: int
    pairs: int
    k: int
    n_max: int
    curve: NDArray[np.float64]

    @property
    def failure_rate(self) -> float:
        """Fraction of the pairs that failed; NaN of no pairs."""
        return self.failures / self.pairs if self.pairs else float("nan")


def histogram(n_k: Iterable[int | None], n_max: int) -> NDArray[np.int64]:
    """How many pairs have n_k = 0 … n_max, and in the last entry how many failed (None, or above ``n_max``).

    (n_max + 2,). Histograms add: the sum of two is the histogram of both sets of pairs. Raises ValueError on a negative
    n_k.
    """
    needed = np.array([n_max + 1 if n is None else n for n in n_k], np.int64)
    if needed.size and needed.min() < 0:
        raise ValueError(f"n_k counts points and cannot be {needed.min()}")
    return np.bincount(np.minimum(needed, n_max + 1), minlength=n_max + 2)


def summarise(counts: NDArray[np.int64], k: int) -> SuccinctnessResult:
    """Everything that is reported about succinctness, from the `histogram` of n_k (n_max + 2,)."""
    n_max = len(counts) - 2
    pairs = int(counts.sum())
    curve = np.cumsum(counts[:-1]) / pairs if pairs else np.full(n_max + 1, np.nan)
    return SuccinctnessResult(
        auc=float(curve[:-1].mean()),
        n_at_80=points_needed(curve, 0.8),
        median=points_needed(curve, 0.5),
        failures=int(counts[-1]),
        pairs=pairs,
        k=k,
        n_max=n_max,
        curve=curve,
    )


class Succinctness(Metric):
    """Succinctness over the pairs given to `update`, merged exactly across processes (its state is a histogram).

    ``update`` takes n_k of one pair or of several, None for a failure. ``compute`` gives the scalars that can be
    logged, ``auc``, ``n_at_80``, ``median`` and ``failure_rate``, NaN where undefined; ``result`` the whole record.
    """

    full_state_update = False
    is_differentiable = False
    higher_is_better = True
    counts: Tensor

    def __init__(self, k: int = 10, n_max: int = 200, **kwargs: Any) -> None:
        """Count ``k`` inliers within ``n_max`` points; ``kwargs`` go to `torchmetrics.Metric`."""
        super().__init__(**kwargs)
        if not 1 <= k < n_max:
            raise ValueError(f"k must be at least 1 and below n_max, not k = {k} with n_max = {n_max}")
        self.k, self.n_max = k, n_max
        self.add_state("counts", torch.zeros(n_max + 2, dtype=torch.long), dist_reduce_fx="sum")

    def update(self, n_k: int | Iterable[int | None] | None) -> None:
        """Add one pair or several."""
        several = n_k if isinstance(n_k, Iterable) else [n_k]
        self.counts += torch.from_numpy(histogram(several, self.n_max)).to(self.counts.device)

    def compute(self) -> dict[str, Tensor]:
        """The scalars of the summary, float32."""
        result = summarise(self.counts.cpu().numpy(), self.k)
        scalars = {name: getattr(result, name) for name in ("auc", "n_at_80", "median", "failure_rate")}
        return {
            name: torch.tensor(torch.nan if value is None else value, dtype=torch.float32, device=self.counts.device)
            for name, value in scalars.items()
        }

    def result(self) -> SuccinctnessResult:
        """The whole summary. In distributed runs every process must call it, and each gets that of all pairs."""
        with self.sync_context(self.dist_sync_fn, distributed_available=self.distributed_available_fn):
            return summarise(self.counts.cpu().numpy(), self.k)
