"""The settings of a run as TensorBoard's table of runs has them."""

from __future__ import annotations

from typing import Any, Final

from omegaconf import DictConfig, OmegaConf

from sips_lit.cli.resuming import flat
from sips_lit.train.validation_data import ValidationDataModule

NAMED: Final = 3
"""Sequences or sources that are named."""
NO_WEIGHTS: Final = frozenset({"points", "compiled", "teacher_decay", "pairs_at_once"})
"""Numbers of a module that weigh no term of its loss."""


def settings_of(config: DictConfig, data: ValidationDataModule) -> dict[str, int | float | str]:
    """What tells runs apart in TensorBoard's table of them, which sorts by name and shows the first five columns."""
    sources = [source.name for source in data.sources]
    names = sources if len(sources) > 1 else [sequence.name for sequence in data.sources[0].sequences]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    module = {name: value for name, value in plain["module"].items() if not isinstance(value, dict | None)}
    numbers = {name: value for name, value in module.items() if isinstance(value, int | float)}
    weights = {name: value for name, value in numbers.items() if name not in NO_WEIGHTS}
    settings: dict[str, Any] = {
        "data": ", ".join(names[:NAMED]) + more,
        "inliers": _class_name(plain["inliers"]),
        "loss": ", ".join(f"{name} {value:g}" for name, value in weights.items()),
        "model": ", ".join(f"{name} {plain['model'][name]}" for name in ("depth", "width")),
        "seed": config.seed,
    }
    pairs = {name: plain["datamodule"].get(name) for name in ("overlap", "spread", "budgets", "between")}
    validation = {name: plain["datamodule"].get(f"val_{name}") for name in ("pairs", "overlap", "fraction", "seed")}
    validation |= {"k": config.k, "n_max": config.n_max}
    pairs |= {"descriptor": _class_name(plain["descriptor"]), "inliers": plain["inliers"]}
    optim = {**plain["optim"], "init": config.init}
    groups = {"model": plain["model"], "module": module, "optim": optim, "pairs": pairs, "validation": validation}
    settings |= flat({**groups, "training": {"augment": plain["augment"]}})
    told = {name: value for name, value in settings.items() if not name.endswith(("_target_", "_partial_"))}
    return {name: value if isinstance(value, int | float | str) else str(value) for name, value in told.items()}


def _class_name(node: Any) -> str:
    return str(node["_target_"]).rpartition(".")[2]
