"""Pose AUC: how precisely poses are estimated, over many pairs (Cieslewski et al., 3DV 2019, AUC-1 m and AUC-1 degree).

AUC-m = (1/m) * integral from 0 to m of the fraction of pairs whose error is at most x: the formula of succinctness, for
an error that is continuous. A pair with error e is part of the fraction from e on, so it adds (m - e) / m, or nothing: the
AUC is the mean of that. A failed pair has an infinite error.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor
from torchmetrics import Metric

_UNITS: Final = 2**32


def gains(errors: ArrayLike, limit: float) -> NDArray[np.float64]:
    """What each of N errors (N,) adds to the AUC up to ``limit``: 1 for none, 0 from the limit on, infinite ones included.

    Raises ValueError on a limit that is not positive, and on an error that is negative or NaN.
    """
    values = np.asarray(errors, np.float64)
    if not 0 < limit < np.inf:
        raise ValueError(f"the limit of a pose AUC must be positive, not {limit}")
    if not (values >= 0).all():
        raise ValueError("errors must not be negative or NaN: a failed pair has an infinite error")
    return np.maximum(1 - values / limit, 0)


def pose_auc(errors: ArrayLike, limit: float) -> float:
    """AUC of N errors (N,) up to ``limit``, in the errors' unit; NaN of none. Raises as `gains`."""
    gained = gains(errors, limit)
    return float(gained.mean()) if gained.size else float("nan")


class PoseAuc(Metric):
    """Pose AUC over the pairs given to `update`, merged exactly across processes (its state is two sums and a count).

    ``compute`` gives ``translation`` and ``rotation``, NaN without any pairs.
    """

    full_state_update = False
    is_differentiable = False
    higher_is_better = True
    gained: Tensor
    pairs: Tensor

    def __init__(self, translation_limit: float = 1.0, rotation_limit: float = 1.0, **kwargs: Any) -> None:
        """Errors up to metres and degrees; ``kwargs`` go to `torchmetrics.Metric`."""
        super().__init__(**kwargs)
        self.limits = (translation_limit, rotation_limit)
        for limit in self.limits:
            gains([], limit)
        # integers in units of 2^-32 add exactly in any order, and every accelerator has them
        self.add_state("gained", torch.zeros(2, dtype=torch.long), dist_reduce_fx="sum")
        self.add_state("pairs", torch.zeros(1, dtype=torch.long), dist_reduce_fx="sum")

    def update(self, translation: ArrayLike, rotation: ArrayLike) -> None:
        """Add one pair or several: their errors in metres and degrees, infinite for failed pairs. Raises as `gains`."""
        both = [gains(np.atleast_1d(e), limit) for e, limit in zip((translation, rotation), self.limits, strict=True)]
        if both[0].shape != both[1].shape:
            raise ValueError(
                f"each pair has both errors: got {len(both[0])} of translation, {len(both[1])} of rotation"
            )
        sums = np.rint(np.stack(both) * _UNITS).astype(np.int64).sum(1)
        self.gained += torch.from_numpy(sums).to(self.gained.device)
        self.pairs += len(both[0])

    def compute(self) -> dict[str, Tensor]:
        """The two AUCs, float32."""
        pairs = int(self.pairs)
        means = [int(total) / _UNITS / pairs if pairs else torch.nan for total in self.gained]
        return {
            name: torch.tensor(mean, dtype=torch.float32, device=self.gained.device)
            for name, mean in zip(("translation", "rotation"), means, strict=True)
        }
