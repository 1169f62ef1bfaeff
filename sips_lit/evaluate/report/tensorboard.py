"""A benchmark in TensorBoard: all figures, and a few numbers of each detector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from sips_lit.evaluate.benchmark_result import PairSetResult
from sips_lit.evaluate.report.columns import columns_of
from sips_lit.evaluate.report.figures import Looks, charts
from sips_lit.evaluate.report.summary import summary


def log_to_tensorboard(folder: Path, results: Sequence[PairSetResult], looks: Looks) -> None:
    """Writes ``benchmark/<set>/<figure>``, and ``benchmark/<set>/<detector>/<column>`` for each finite number."""
    with SummaryWriter(str(folder)) as writer:
        for result in results:
            rows = [summary(detector) for detector in result.detectors]
            columns = columns_of(rows)
            for detector, row in zip(result.detectors, rows, strict=True):
                for column in columns:
                    value = column.value(row)
                    if math.isfinite(value):
                        writer.add_scalar(f"benchmark/{result.key}/{detector.key}/{column.key}", value)
            for chart in charts(result, looks):
                writer.add_figure(f"benchmark/{result.key}/{chart.key}", chart.figure, close=False)
