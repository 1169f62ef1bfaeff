"""Reading a trained network back: from a Lightning checkpoint or an exported safetensors file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError

METADATA_KEY = "sips_lit"
PREFIX = "network."


def load_checkpoint(path: str | Path) -> tuple[ScoreNetwork, PointSelector]:
    """The network, in evaluation mode, and how it selects points, from a ``.ckpt`` or ``.safetensors`` file.

    Raises BadInputError when the file is missing, damaged, or not of this architecture.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInputError(
            f"there is no checkpoint {path}: give a .ckpt file of a run, or an exported .safetensors file"
        )
    config, weights = _read_safetensors(path) if path.suffix == ".safetensors" else _read_lightning(path)
    try:
        network, selector = ScoreNetwork(**config["network"]), PointSelector(**config["selector"])
        network.load_state_dict(dict(weights))
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0].rstrip(":")
        raise BadInputError(
            f"{path} is not a checkpoint of a sips_lit score network ({reason}): use one of sips-train"
        ) from error
    return network.eval(), selector


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """All that a ``.ckpt`` file holds, on the CPU. Raises BadInputError when it can't be read."""
    try:
        checkpoint: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        checkpoint["state_dict"], checkpoint["hyper_parameters"]
    except Exception as error:  # damaged bytes make the unpickler raise almost anything
        raise BadInputError(f"{path} can't be read as a checkpoint: it is damaged, or not one of sips-train") from error
    return checkpoint


def _read_lightning(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Tensor]]:
    checkpoint = read_checkpoint(path)
    weights = {k.removeprefix(PREFIX): v for k, v in checkpoint["state_dict"].items() if k.startswith(PREFIX)}
    return checkpoint["hyper_parameters"], weights


def _read_safetensors(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Tensor]]:
    try:
        with safe_open(path, framework="pt") as stored:
            config = json.loads((stored.metadata() or {})[METADATA_KEY])
            return config, {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise BadInputError(f"{path} can't be read: it is damaged, or was not written by sips-export") from error
