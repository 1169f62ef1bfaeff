"""Base of metrics whose state is sums that are the same in whatever order they are added, on any number of processes."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics import Metric

Summary = TypeVar("Summary")


class ExactSums(Metric, Generic[Summary]):
    """Sums of a ``shape``, kept as integers: they add exactly, and every accelerator has them.

    Apple's has no float64, and float32 sums lose ones after 2^24. A subclass adds to them in `update` by `_add`, says by
    ``units`` how fine they are (1 / units), and summarises them; ``scalars`` are the numbers of the summary that `compute`
    gives. ``kwargs`` go to `torchmetrics.Metric`.
    """

    full_state_update = False
    is_differentiable = False
    higher_is_better = False
    units: ClassVar[int]
    scalars: ClassVar[tuple[str, ...]]
    sums: Tensor

    def __init__(self, *shape: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.add_state("sums", torch.zeros(shape, dtype=torch.long), dist_reduce_fx="sum")

    @abstractmethod
    def summarised(self, sums: NDArray[np.float64]) -> Summary:
        """The record of sums of the metric's shape."""

    def compute(self) -> dict[str, Tensor]:
        """The scalars of the summary, float32."""
        result = self._summary()
        device = self.sums.device
        return {n: torch.tensor(getattr(result, n), dtype=torch.float32, device=device) for n in self.scalars}

    def result(self) -> Summary:
        """The whole summary. In distributed runs every process must call it, and each gets that of everything."""
        with self.sync_context(self.dist_sync_fn, distributed_available=self.distributed_available_fn):
            return self._summary()

    def _add(self, sums: NDArray[np.float64]) -> None:
        self.sums += torch.from_numpy(np.rint(sums * self.units).astype(np.int64)).to(self.sums.device)

    def _summary(self) -> Summary:
        return self.summarised(self.sums.cpu().numpy() / self.units)
