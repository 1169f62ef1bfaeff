"""Where numbers and pictures of a run go in TensorBoard: to cards with their descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.utilities import rank_zero_only
from matplotlib.figure import Figure
from tensorboard.compat.proto.summary_pb2 import DATA_CLASS_BLOB_SEQUENCE, DATA_CLASS_SCALAR, SummaryMetadata
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard import summary as untyped

from sips_lit.callbacks.cards import LAYOUT, RUN_METRICS, card_of
from sips_lit.render.canvas import Picture
from sips_lit.render.figure import figure_to_array

summary: Any = untyped

# TensorBoard drops the description of a value whose kind it has to find out
_SCALAR = SummaryMetadata(plugin_data=SummaryMetadata.PluginData(plugin_name="scalars"), data_class=DATA_CLASS_SCALAR)
_IMAGE = SummaryMetadata(
    plugin_data=SummaryMetadata.PluginData(plugin_name="images"), data_class=DATA_CLASS_BLOB_SEQUENCE
)


class TensorBoard(TensorBoardLogger):
    """Lightning's logger with each number on its `Card`, and charts that join lines which are read together.

    The epoch, which Lightning logs with everything, is left out: a run is one.
    """

    def __init__(self, save_dir: str | Path, name: str = "", version: str = "", **options: Any) -> None:
        super().__init__(save_dir, str(name), str(version), **options)  # a name may be a number
        self._has_layout = False

    @rank_zero_only
    def log_metrics(self, metrics: Mapping[str, Any], step: int | None = None) -> None:
        """Writes numbers by their names."""
        if not self._has_layout:
            charts = {title: {name: ["Multiline", tags] for name, tags in row.items()} for title, row in LAYOUT.items()}
            self.experiment.add_custom_scalars(charts)
            self._has_layout = True
        for name, value in metrics.items():
            if name != "epoch":
                card = card_of(name)
                _write(self.experiment, summary.scalar(card.tag, float(value)), _SCALAR, card.text, step)

    @rank_zero_only
    def log_settings(self, settings: Mapping[str, int | float | str]) -> None:
        """Makes a row of the table of runs: what was set, and the columns of `RUN_METRICS`, which fill with validations."""
        self.log_hyperparams(dict(settings))
        # as the logger makes it, but without values of the metrics: there are none before a validation
        names = {card_of(metric).tag: title for metric, title in RUN_METRICS.items()}
        experiment, *session = summary.hparams(dict(settings), dict.fromkeys(names))
        plugin = experiment.value[0].metadata.plugin_data
        table = HParamsPluginData.FromString(plugin.content)
        for metric in table.experiment.metric_infos:
            metric.display_name = names[metric.name.tag]
        plugin.content = table.SerializeToString()
        for part in (experiment, *session):
            self.experiment._get_file_writer().add_summary(part)


def writer_of(trainer: L.Trainer) -> SummaryWriter | None:
    """The TensorBoard writer of a trainer; None without such a logger and on processes but the first."""
    loggers = trainer.loggers if trainer.is_global_zero else []
    return next((logger.experiment for logger in loggers if isinstance(logger, TensorBoardLogger)), None)


def show(trainer: L.Trainer, name: str, picture: Picture | Figure) -> None:
    """Puts a picture or a figure on its `Card` at the trainer's step, where there is a TensorBoard."""
    writer = writer_of(trainer)
    if writer is None:
        return
    drawn, card = figure_to_array(picture) if isinstance(picture, Figure) else picture, card_of(name)
    _write(writer, summary.image(card.tag, drawn, dataformats="HWC"), _IMAGE, card.text, trainer.global_step)


def _write(writer: Any, content: Any, kind: Any, text: str, step: int | None) -> None:
    """Adds a summary with a description, which the writer's own ``add_scalar`` and ``add_image`` have no argument for."""
    for value in content.value:
        value.metadata.CopyFrom(kind)
        value.metadata.summary_description = text
    writer._get_file_writer().add_summary(content, step)  # the public attribute is None once it was closed
