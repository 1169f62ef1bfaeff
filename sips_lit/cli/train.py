"""sips-train: trains, validates, and compares if asked to."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import lightning as L
from lightning.pytorch.callbacks import ProgressBar
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig, OmegaConf

from sips_lit.callbacks.continuation import Continuation
from sips_lit.cli.app import build, run
from sips_lit.cli.benchmark import benchmark
from sips_lit.cli.resuming import find_start, flat, record_of
from sips_lit.errors import BadInputError
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.module import SipsModule

RUN_METRIC = "best_succinctness_auc"


def train(config: DictConfig) -> float:
    """One run. Returns the best validation succinctness AUC, which is what a sweep maximises."""
    cv2.setNumThreads(1)  # the labelling threads share the cores with the network
    L.seed_everything(config.seed, workers=True, verbose=False)
    interval = pairs_between_validations(config.trainer)
    data: PairDataModule = build(config.datamodule)
    module: SipsModule = build(config.module)
    trainer: L.Trainer = build(
        config.trainer, callbacks=make_callbacks(config), logger=build(config.logger), val_check_interval=interval
    )
    record = record_of(config, data, trainer)
    trainer.callbacks.append(Continuation(record))  # type: ignore[attr-defined]  # set by the trainer's connector
    start = find_start(config, record)
    if trainer.is_global_zero:
        print(f"run folder: {config.paths.run}\nprecision: {config.trainer.precision}", flush=True)
        if start is not None:
            finished = ": the run is finished" if start.step == trainer.max_steps else ""
            print(f"going on from {start.path}, step {start.step} of {trainer.max_steps}{finished}", flush=True)
    log_settings(trainer, config)
    trainer.fit(module, data, ckpt_path=None if start is None else start.path)
    best, auc = _best(trainer)
    for logger in trainer.loggers:
        logger.log_metrics({RUN_METRIC: auc}, trainer.global_step)
    if trainer.is_global_zero:
        _report(trainer, data, best, auc, Path(config.paths.run), Path(config.paths.outputs))
        if config.compare is not None:
            if best is None:
                raise BadInputError(
                    "the run has no best checkpoint to compare: set callbacks.checkpoint, or compare=null"
                )
            compared = comparison(config, best)
            compared.paths.run = str(Path(config.paths.run) / "compare")
            benchmark(compared)
    return auc


def make_callbacks(config: DictConfig) -> list[L.Callback]:
    """The callbacks; no progress with ``trainer.enable_progress_bar=false``, where Lightning refuses one."""
    callbacks = build(config.callbacks).values()
    silent = config.trainer.enable_progress_bar is False
    return [callback for callback in callbacks if not (silent and isinstance(callback, ProgressBar))]


def comparison(config: DictConfig, checkpoint: Path) -> DictConfig:
    """``compare``, which has the keys of sips-benchmark, as a configuration of its own, of this checkpoint."""
    keys: Any = OmegaConf.to_container(config.compare, resolve=True)
    return OmegaConf.create({**keys, "checkpoint": str(checkpoint), "paths": config.paths})


def log_settings(trainer: L.Trainer, config: DictConfig) -> None:
    """The settings of the run for TensorBoard's table of runs, with the metric that compares them."""
    parts = {key: OmegaConf.to_container(config[key], resolve=True) for key in ("model", "optim", "augment")}
    settings = {name: value for name, value in flat(parts) if not name.endswith(("_target_", "_partial_"))}
    settings |= {"seed": config.seed, "points": config.module.points, "overlap": config.datamodule.overlap}
    for logger in trainer.loggers:
        if isinstance(logger, TensorBoardLogger):
            logger.log_hyperparams(settings, {RUN_METRIC: float("nan")})


def pairs_between_validations(trainer: DictConfig) -> int:
    """What Lightning calls ``val_check_interval``: it counts pairs, where the configuration counts optimiser steps.

    At least the last step validates. Raises BadInputError unless training and validation are counted in steps.
    """
    for key in ("max_steps", "val_check_interval"):
        if not isinstance(trainer[key], int) or trainer[key] < 1:
            raise BadInputError(f"trainer.{key} is {trainer[key]}: set it to a number of steps, 1 or more")
    return int(min(trainer.val_check_interval, trainer.max_steps) * trainer.accumulate_grad_batches)


def _best(trainer: L.Trainer) -> tuple[Path | None, float]:
    checkpoint = trainer.checkpoint_callback
    score = getattr(checkpoint, "best_model_score", None)
    if checkpoint is None or score is None:
        return None, float(trainer.callback_metrics.get("val/succinctness_auc", float("nan")))
    return Path(getattr(checkpoint, "best_model_path", "")), float(score)


def _report(
    trainer: L.Trainer, data: PairDataModule, best: Path | None, auc: float, folder: Path, outputs: Path
) -> None:
    if data.skipped.count:
        print(f"warning: {data.skipped}", file=sys.stderr)
    print(f"\nbest validation AUC {auc:.3f} on {len(data.val_choices)} fixed pairs ({data.validation_digest()})")
    print(f"checkpoint:  {best or 'none'}\npictures:    {folder / 'pictures'}")
    print(f"TensorBoard: tensorboard --logdir {outputs}")


main = partial(run, "train", train)

if __name__ == "__main__":
    main()
