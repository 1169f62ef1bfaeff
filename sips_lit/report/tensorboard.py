"""The numbers of the tables in TensorBoard."""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch.utils.tensorboard import SummaryWriter

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import columns_of


def log_numbers(writer: SummaryWriter, results: Sequence[PairSetResult]) -> None:
    """Logs ``benchmark/<set>/<method>/<column>`` for each finite number of the tables."""
    for result in results:
        columns = columns_of(result.detectors)
        for method in result.detectors:
            for column in columns:
                value = column.value(method)
                if math.isfinite(value):
                    writer.add_scalar(f"benchmark/{result.key}/{method.key}/{column.key}", value)
