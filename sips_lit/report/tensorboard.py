"""The numbers of a benchmark in TensorBoard."""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch.utils.tensorboard import SummaryWriter

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import columns_of
from sips_lit.report.summary import summary


def log_numbers(writer: SummaryWriter, results: Sequence[PairSetResult]) -> None:
    """Logs ``benchmark/<set>/<detector>/<column>`` for each finite number of the tables."""
    for result in results:
        rows = [summary(detector) for detector in result.detectors]
        columns = columns_of(rows)
        for detector, row in zip(result.detectors, rows, strict=True):
            for column in columns:
                value = column.value(row)
                if math.isfinite(value):
                    writer.add_scalar(f"benchmark/{result.key}/{detector.key}/{column.key}", value)
