"""Going on: from which checkpoint a run may go on, which is one of the same run only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import lightning as L
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from sips_lit.callbacks.continuation import RECORD, identity_of
from sips_lit.callbacks.slurm import started_again
from sips_lit.cli.arguments import holds_path
from sips_lit.cli.explain import origin
from sips_lit.detect.checkpoint import digest_of, read_checkpoint
from sips_lit.errors import BadInputError, warn_input
from sips_lit.train.checkpoint_io import sound_checkpoint
from sips_lit.train.score_module import ScoreModule
from sips_lit.train.validation_data import ValidationDataModule

TRAINER: Final = ("accumulate_grad_batches", "gradient_clip_val", "limit_val_batches")
WITHOUT_EFFECT: Final = frozenset({"loading_workers", "labelling_workers", "index_folder", "gradient_costs"})
START_WEIGHTS = "weights of init"
FRAMES, SAMPLE, STEPS, PRECISION = "frames", "sample of frames", "trainer.max_steps", "trainer.precision"
TOLD = 6  # differences that a sentence names


@dataclass(frozen=True, slots=True)
class Start:
    """The checkpoint that a run goes on from, and the step that it was saved after."""

    path: Path
    step: int


def record_of(
    config: DictConfig, data: ValidationDataModule, trainer: L.Trainer, module: ScoreModule
) -> dict[str, dict[str, Any]]:
    """What a run is, by the keys that a user sets, with plain values, for its checkpoints.

    ``identity``: what it trains, on which frames, from which seed and weights, how it is optimised and validated; ``told``:
    what may change while it stays the same run: its length, its precision (another machine has another), where its data
    are, and times of their files (a copy has others), as long as the frames look the same.
    """
    validation = config.callbacks.get("succinctness") or OmegaConf.create()
    average = config.callbacks.get("average") or OmegaConf.create()
    parts = {"module": config.module, "datamodule": config.datamodule}
    parts |= {"callbacks.succinctness": validation, "callbacks.average": average}
    values = dict(flat({name: OmegaConf.to_container(part, resolve=True) for name, part in parts.items()}))
    values |= {f"trainer.{key}": config.trainer[key] for key in TRAINER}
    plain = OmegaConf.to_container(config)
    named = {origin(key, plain): value for key, value in values.items() if key.rpartition(".")[2] not in WITHOUT_EFFECT}
    paths = {key: value for key, value in named.items() if holds_path(key)}
    identity = {key: value for key, value in named.items() if key not in paths}
    identity |= {} if config.init is None else {START_WEIGHTS: digest_of(module.network)}
    identity |= module.learns_from
    identity |= {"processes": trainer.num_nodes * trainer.num_devices, FRAMES: data.data_digest()}
    told = {**paths, STEPS: config.trainer.max_steps, PRECISION: config.trainer.precision, SAMPLE: data.sample_digest()}
    return {"identity": identity, "told": told}


def flat(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names with dots and values of nested mappings."""
    for name, value in node.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def find_start(config: DictConfig, record: Mapping[str, Any]) -> Start | None:
    """The checkpoint that ``ckpt_path`` asks for: none, a file, or with "last" the last one of this run.

    That is in the run folder, or else the newest below ``paths.outputs`` that has the identity of this run. In a multirun
    it is in the job's folder, and a job that had not begun has none. A job that Slurm starts again goes on from
    its own, whatever it was asked for. Raises BadInputError when there is no such file, when it is damaged or of another
    run, or when it leaves no step to make.
    """
    own = Path(config.paths.run) / "checkpoints" / "last.ckpt"
    wanted = "last" if started_again() and own.is_file() else config.ckpt_path
    if wanted is None:
        return None
    path = Path(wanted)
    if wanted == "last":
        path = own
        if not path.is_file() and HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN:
            _require_begun(Path(HydraConfig.get().sweep.dir))
            return None
        path = path if path.is_file() else _newest(Path(config.paths.outputs), record)
    elif not path.is_file():
        raise BadInputError(f"there is no checkpoint {path} to go on from")
    path = sound_checkpoint(path)
    content = _read(path)
    different = differences(content, record)
    if different:
        raise _of_another_run(f"{path} is", different)
    done, steps = content["global_step"], record["told"][STEPS]
    planned = content[RECORD]["told"][STEPS]
    if done > steps or done == steps != planned:
        raise BadInputError(
            f"{path} has made {done} of {planned} steps, so {STEPS}={steps} leaves none to make: give a larger number"
        )
    before, now = content[RECORD]["told"].get(PRECISION), record["told"][PRECISION]
    if before not in (None, now):
        warn_input(
            f"{path} was trained with {PRECISION}={before}, this run goes on with {now}: its end will be another"
        )
    return Start(path, done)


def differences(content: Mapping[str, Any], record: Mapping[str, Any]) -> list[str]:
    """What the run of a checkpoint has that this one has not; empty if it is the same."""
    old, new = identity_of(content), record["identity"]
    keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    settings = [_told(key, old.get(key), new.get(key)) for key in keys if key != FRAMES]
    old, new = content[RECORD]["told"], record["told"]
    if FRAMES not in keys or settings or old.get(SAMPLE) == new[SAMPLE]:
        return settings
    paths = [_told(key, old.get(key), new[key]) for key in new if holds_path(key) and old.get(key) != new[key]]
    return ["other frames (by the names, sizes and times of their files, and by how they look)", *paths]


def _told(key: str, there: Any, here: Any) -> str:
    return f"{key}={there} (here {here})"


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".safetensors":
        raise BadInputError(f"{path} holds weights only: ckpt_path must be the .ckpt file of a run")
    content = read_checkpoint(path)
    if "optimizer_states" not in content:
        raise BadInputError(f"{path} has no state of the optimiser: ckpt_path must be a whole checkpoint of a run")
    if RECORD not in content:
        raise BadInputError(f"{path} does not tell of which run it is: it is of an earlier version, so begin anew")
    return content


def _newest(outputs: Path, record: Mapping[str, Any]) -> Path:
    found = sorted(outputs.rglob("last.ckpt"), key=lambda path: path.stat().st_mtime, reverse=True)
    if not found:
        raise BadInputError(
            f"ckpt_path=last, but there is no last.ckpt in {outputs}: train first, or name a checkpoint"
        )
    others: list[tuple[Path, list[str]]] = []
    for path in map(sound_checkpoint, found):
        try:
            different = differences(_read(path), record)
        except BadInputError as error:
            if len(found) == 1:
                raise
            warn_input(f"{error}; it is passed over")
            continue
        if not different:
            return path
        others.append((path, different))
    if not others:
        raise BadInputError(f"no last.ckpt in {outputs} can be read: train anew, or name a checkpoint")
    raise _of_another_run(f"no last.ckpt in {outputs} is of this run: the newest, {others[0][0]}, is", others[0][1])


def _of_another_run(which: str, different: list[str]) -> BadInputError:
    more = f" and {len(different) - TOLD} settings more" if len(different) > TOLD else ""
    return BadInputError(
        f"{which} of another run, with {', '.join(different[:TOLD])}{more}: give the same to go on, or leave out ckpt_path "
        "to begin anew"
    )


def _require_begun(sweep: Path) -> None:
    """Raises BadInputError when no job of a sweep has a checkpoint: then there is no sweep to take up."""
    if next(sweep.rglob("last.ckpt"), None) is None:
        raise BadInputError(
            f"in a multirun ckpt_path=last takes a job's own checkpoint, and no job in {sweep} has one: set hydra.sweep.dir "
            "to the folder of the sweep that is to be taken up, or leave out ckpt_path"
        )
