"""sips-train: trains, validates, and compares if asked to."""

from __future__ import annotations

import math
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import cv2
import lightning as L
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.callbacks import ProgressBar
from lightning.pytorch.utilities.seed import isolate_rng
from omegaconf import DictConfig, OmegaConf

from sips_lit.callbacks.continuation import Continuation
from sips_lit.callbacks.fine_tuning import FineTuning
from sips_lit.callbacks.prospects import Prospects
from sips_lit.callbacks.step_times import StepTimes
from sips_lit.callbacks.tensorboard import TensorBoard
from sips_lit.cli.app import build, run
from sips_lit.cli.benchmark import benchmark
from sips_lit.cli.evaluation import make_pair_sets
from sips_lit.cli.explain import explain
from sips_lit.cli.methods import make_methods
from sips_lit.cli.next_steps import after_training
from sips_lit.cli.resuming import find_start, record_of
from sips_lit.cli.run_settings import settings_of
from sips_lit.cli.validation_record import write_record
from sips_lit.cli.value_types import refuse_wrong_keys
from sips_lit.detect.checkpoint import export_safetensors, start_from
from sips_lit.errors import BadInputError, warn_input
from sips_lit.train.score_module import ScoreModule
from sips_lit.train.validation_data import ValidationDataModule

AUC = "val/succinctness_auc"
LARGEST_SEED: Final = 2**32 - 1  # that NumPy takes
KEYS: Final = {"seed": int, "val_seed": int, "k": int, "n_max": int, "ckpt_path": Path | None, "init": Path | None}
"""Keys of the command itself, with what they take."""


def train(config: DictConfig) -> float:
    """One run. Returns the best validation succinctness AUC, which is what a sweep maximises."""
    refuse_wrong_keys(config, KEYS)
    if not 0 <= config.seed <= LARGEST_SEED:
        raise BadInputError(f"seed is {config.seed}: give a whole number from 0 to {LARGEST_SEED}")
    if not isinstance(config.compare, DictConfig | None):
        raise BadInputError(f"compare is {config.compare}: give keys of sips-benchmark, as experiment=quickstart does")
    profiler = config.trainer.profiler
    if not (isinstance(profiler, str) or is_part(profiler)):
        raise BadInputError(f"trainer.profiler is {profiler}: give simple, advanced or pytorch, or null")
    cv2.setNumThreads(1)  # the labelling threads share the cores with the network
    L.seed_everything(config.seed, workers=True, verbose=False)
    interval = pairs_between_validations(config.trainer)
    data: ValidationDataModule = build(config.datamodule)
    module: ScoreModule = build(config.module)
    if config.init is not None:
        start_from(module.network, config.init)
    callbacks = make_callbacks(config)
    if config.module.points < config.k:
        raise BadInputError(
            f"module.points is {config.module.points}, and k = {config.k} inliers are needed: select more"
        )
    trainer: L.Trainer = build(
        config.trainer, callbacks=callbacks, logger=build(config.logger), val_check_interval=interval
    )
    record = record_of(config, data, trainer, module)
    fine_tuning = FineTuning() if config.init is not None and module.learns == "scores" else None
    own = [Continuation(record), *([] if fine_tuning is None else [fine_tuning])]
    trainer.callbacks.extend(own)  # type: ignore[attr-defined]  # set by the trainer's connector
    start = find_start(config, record)
    if config.compare is not None and trainer.is_global_zero:
        check_comparison(config, module)
    if trainer.is_global_zero:
        print(f"run folder: {config.paths.run}\nprecision: {config.trainer.precision}", flush=True)
        if start is not None:
            finished = ": the run is finished" if start.step == trainer.max_steps else ""
            print(f"going on from {start.path}, step {start.step} of {trainer.max_steps}{finished}", flush=True)
    for logger in trainer.loggers if trainer.is_global_zero else ():
        if isinstance(logger, TensorBoard):
            logger.log_settings(settings_of(config, data))
    trainer.fit(module, data, ckpt_path=None if start is None else start.path)
    best, auc = _best(trainer)
    if not trainer.is_global_zero:
        return auc
    validated_on = write_record(config, data.validation_pairs())
    if trainer.global_step < trainer.max_steps:
        why = f"trainer.max_time={config.trainer.max_time}" if config.trainer.max_time else "a callback"
        print(f"{why} ended the run after {trainer.global_step} of {trainer.max_steps} steps: ckpt_path=last goes on")
    if math.isnan(auc):
        raise BadInputError("the run has no score: its best checkpoint is lost, and there was no validation since")
    if auc == 0:
        reasons = [callback.failure for callback in callbacks if isinstance(callback, Prospects) and callback.failure]
        why = reasons[0] if reasons else "no validation pair succeeded"
        told = f"the training did not work, its best validation AUC is 0: {why}"
        if not _in_multirun():
            raise BadInputError(told)
        warn_input(told)  # a search goes on with it as the lowest score
        return auc
    _report(data, validated_on, best, auc, Path(config.paths.run))
    workers = config.datamodule.loading_workers, config.datamodule.get("labelling_workers", 0)
    for times in (callback.told(*workers) for callback in callbacks if isinstance(callback, StepTimes)):
        if times is not None:
            print(f"time:        {times}")
    if module.learns == "covariance":
        last = {name: float(trainer.callback_metrics[f"val/covariance_{name}"]) for name in ("error", "scale")}
        print(f"covariance:  error of its reliability {last['error']:.3f}, needed factor {last['scale']:.2f}")
    if fine_tuning is not None:
        print(f"fine-tuning: {fine_tuning.told(auc, config.init)}")
    if config.compare is not None and best is not None:
        benchmark(comparison(config, best))
    return auc


def _in_multirun() -> bool:
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def is_part(node: Any) -> bool:
    """Whether it is a configuration of something that can be made, or null."""
    return node is None or (isinstance(node, DictConfig) and "_target_" in node)


def make_callbacks(config: DictConfig) -> list[L.Callback]:
    """The callbacks; no progress with ``trainer.enable_progress_bar=false``, where Lightning refuses one.

    Raises BadInputError for what is none.
    """
    for name, node in config.callbacks.items():
        if not is_part(node):
            raise BadInputError(f"callbacks.{name!s} is {node}: give a configuration, with _target_, or null")
    callbacks = [callback for callback in build(config.callbacks).values() if callback is not None]
    silent = config.trainer.enable_progress_bar is False
    return [callback for callback in callbacks if not (silent and isinstance(callback, ProgressBar))]


def comparison(config: DictConfig, checkpoint: Path) -> DictConfig:
    """``compare``, which has the keys of sips-benchmark, as a configuration of its own, of this checkpoint."""
    keys: Any = OmegaConf.to_container(config.compare, resolve=True)
    paths = {**config.paths, "run": str(Path(config.paths.run) / "compare")}
    return OmegaConf.create({**keys, "checkpoint": str(checkpoint), "paths": paths})


def check_comparison(config: DictConfig, module: ScoreModule) -> None:
    """Prepares the comparison that follows a run, with the network as it is: its mistakes end the run before it trains.

    Raises BadInputError for whatever the comparison can't use, and for a detector of its list that can't be made.
    """
    if config.callbacks.checkpoint is None:
        raise BadInputError("compare needs the best checkpoint of the run: leave callbacks.checkpoint as it is")
    with TemporaryDirectory() as folder, isolate_rng():
        checkpoint = Path(folder) / "untrained.safetensors"
        export_safetensors(module.network, module.selector, checkpoint)
        compared, skipped = comparison(config, checkpoint), dict[str, str]()
        try:
            make_methods(compared, skipped.__setitem__)
            if skipped and compared.detectors != "all":
                raise BadInputError("; ".join(f"{key} can't be compared: {why}" for key, why in skipped.items()))
            make_pair_sets(compared, Path(compared.paths.run))
        except Exception as error:
            sentence = explain(error, compared)
            if sentence is None:
                raise
            raise BadInputError(f"compare: {sentence}") from error


def pairs_between_validations(trainer: DictConfig) -> int:
    """What Lightning calls ``val_check_interval``: it counts pairs, where the configuration counts optimiser steps.

    At least the last step validates. Raises BadInputError unless training and validation are counted in steps.
    """
    for key, what in (("max_steps", "steps"), ("val_check_interval", "steps"), ("accumulate_grad_batches", "pairs")):
        if not isinstance(trainer[key], int) or trainer[key] < 1:
            raise BadInputError(f"trainer.{key} is {trainer[key]}: set it to a number of {what}, 1 or more")
    if trainer.check_val_every_n_epoch not in (None, 1):
        raise BadInputError(
            f"trainer.check_val_every_n_epoch is {trainer.check_val_every_n_epoch}: leave it null, a run is one epoch, and "
            "trainer.val_check_interval says when it validates"
        )
    if trainer.limit_val_batches == 0:
        raise BadInputError(
            "trainer.limit_val_batches is 0: checkpoints are saved after validations, so let it validate"
        )
    return int(min(trainer.val_check_interval, trainer.max_steps) * trainer.accumulate_grad_batches)


def _best(trainer: L.Trainer) -> tuple[Path | None, float]:
    checkpoint = trainer.checkpoint_callback
    score = getattr(checkpoint, "best_model_score", None)
    if checkpoint is None or score is None:
        return None, float(trainer.callback_metrics.get(AUC, float("nan")))
    if getattr(checkpoint, "monitor", None) != AUC:  # scores that a run leaves alone have one AUC
        score = trainer.callback_metrics[AUC]
    return Path(getattr(checkpoint, "best_model_path", "")), float(score)


def _report(data: ValidationDataModule, validated_on: str, best: Path | None, auc: float, folder: Path) -> None:
    if data.skipped.count:
        print(f"warning: {data.skipped}", file=sys.stderr)
    print(f"\nbest validation AUC {auc:.3f} on {len(data.val_choices)} fixed pairs ({validated_on})")
    print(f"checkpoint:  {best or 'none'}\npictures:    {folder / 'pictures'}")


main = partial(run, "train", train, after_training)

if __name__ == "__main__":
    main()
