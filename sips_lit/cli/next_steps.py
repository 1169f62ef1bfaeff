"""What one may do after a run, as commands that can be pasted."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, ListConfig

from sips_lit.cli.arguments import holds_path, path_argument

FRAMES = ("video", "folder")  # choices of data that sips-detect reads by the same path
POINTS: Final = "n=[10,25,50,100,200,500]"
DETECTORS: Final = "detectors=[sips,sift,orb]"


def told(commands: Sequence[Sequence[str]]) -> str:
    """The commands, each on a line of its own, quoted for the shell."""
    return "\n".join(["\nnext:", *(f"  {shlex.join(command)}" for command in commands)])


def tensorboard(config: DictConfig) -> list[list[str]]:
    """Looking at the curves of all runs."""
    return [["tensorboard", "--logdir", str(config.paths.outputs)]]


def after_training(config: DictConfig) -> list[list[str]]:
    """Using the best checkpoint, measuring it, looking at the curves."""
    saved = config.callbacks.checkpoint
    elsewhere = saved is None or saved.dirpath is None  # where Lightning chooses the folder
    best = None if elsewhere else Path(saved.dirpath) / f"{saved.filename}.ckpt"
    if best is None or not best.is_file():
        return tensorboard(config)
    checkpoint = path_argument("checkpoint", best)
    commands = []
    validated = config.val_data if config.val_data is not None else config.data
    path, choices = validated.get("path"), HydraConfig.get().runtime.choices
    kind = choices.get("data@val_data") or choices.get("data")
    if kind in FRAMES and isinstance(path, str) and Path(path).exists():
        output = path_argument("output", Path(config.paths.run) / "points")
        commands.append(["sips-detect", checkpoint, path_argument("input", Path(path)), output])
    if choices.get("experiment") is None:  # an experiment may hold keys that an evaluation does not have
        commands.append(["sips-evaluate", checkpoint, f"data={kind}", *_settings_of_pairs()])
    return [*commands, *tensorboard(config)]


def after_odometry(config: DictConfig) -> list[list[str]]:
    """The same camera by several detectors with several numbers of points; after both, what the detectors cost."""
    given = {str(o).partition("=")[0]: pasted(str(o)) for o in HydraConfig.get().overrides.task}
    several = {"n": isinstance(config.n, ListConfig), "detectors": config.detectors is not None}
    if all(several.values()):
        return [["sips-speed", given.get("detectors", DETECTORS)]]
    given |= {key: value for key, value in (("n", POINTS), ("detectors", DETECTORS)) if not several[key]}
    return [["sips-odometry", *given.values()]]


def after_speed(input_path: Path | None, fastest: Mapping[str, Any] | None) -> list[list[str]]:
    """The points of what was measured on, by the fastest of our own detectors, of which the configuration is given."""
    if input_path is None or fastest is None:
        return []
    own = [f"{key}={fastest[key]}" for key in ("runtime", "precision") if key in fastest]
    checkpoint, found = path_argument("checkpoint", Path(fastest["path"])), path_argument("input", input_path)
    return [["sips-detect", checkpoint, *own, found]]


def _settings_of_pairs() -> list[str]:
    """What the command line said of the pairs that were validated on, as sips-evaluate has it."""
    hydra = HydraConfig.get()
    own = hydra.runtime.choices.get("data@val_data") is not None
    data = "val_data." if own else "data."
    given = [str(override) for override in hydra.overrides.task]
    of_data = [pasted(override.replace("val_data.", "data.", 1)) for override in given if override.startswith(data)]
    parts = [override for override in given if override.partition("=")[0].split(".")[0] in ("inliers", "descriptor")]
    return of_data + parts


def pasted(override: str) -> str:
    """An override as one would type it: a path that was quoted for Hydra without its quotes, where that reads the same."""
    key, _, value = override.partition("=")
    if not holds_path(key.lstrip("+")) or not value.startswith("'"):
        return override
    text = OverridesParser.create().parse_override(override).value()
    return path_argument(key, Path(text)) if isinstance(text, str) else override
