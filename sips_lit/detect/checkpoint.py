"""Trained networks in files: Lightning checkpoints are read; safetensors, which can't run code, are read and written."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from sips_lit.archives.zip_members import is_bomb
from sips_lit.detect.detection_logits import Detection
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.released import checkpoint_file
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.files import write_whole

METADATA_KEY = "sips_lit"
RECALIBRATION = "recalibration"
PREFIX = "network."
LEARNED = ("depth", "width", "leaky_slope", "scales", "scale_factor", "derivatives")  # what weights are learned for
ARCHITECTURE = (*LEARNED, *(part.name for part in fields(Detection)))  # of what gives the logits


def load_checkpoint(path: str | Path) -> tuple[ScoreNetwork, PointSelector]:
    """The network, in evaluation mode, and how it selects points, from a ``.ckpt`` or ``.safetensors`` file.

    ``path``: also a name of `sips_lit.detect.released`. Raises BadInputError when the file is missing, damaged, or not of
    this architecture.
    """
    path = checkpoint_file(path)
    config, weights = (_read_safetensors if path.suffix.lower() == ".safetensors" else _read_lightning)(path)
    try:
        if _asks_for_more(config["network"], weights):
            raise ValueError("its weights are of another size than it says")
        network, selector = ScoreNetwork(**config["network"]), PointSelector(**config["selector"])
        if {name: w.shape for name, w in network.state_dict().items()} != {
            name: w.shape for name, w in weights.items()
        }:
            raise ValueError("its weights are of another size than it says")
        selector = replace(selector, recalibration=Recalibration(**config.get(RECALIBRATION, {})))
        network.load_state_dict(dict(weights))
    except Exception as error:  # it may hold anything
        reason = str(error).partition("\n")[0].rstrip(":")
        raise BadInputError(
            f"{path} is not a checkpoint of a sips_lit score network ({reason}): use one of sips-train"
        ) from error
    return network.eval(), selector


def _asks_for_more(config: Mapping[str, Any], weights: Mapping[str, Tensor]) -> bool:
    """Whether a network would be larger than the weights that there are for it: a damaged file may ask for any memory.

    PyTorch's device meta, which is without memory, takes 80 MB and a second when it is first used.
    """
    layers = [weight for name, weight in weights.items() if name.startswith("layers.") and weight.ndim == 4]
    widest = max((weight.shape[0] for weight in layers), default=0)
    return bool(config.get("depth", 0) > len(layers) or config.get("width", 0) > 2 * widest)


def load_network(path: str | Path) -> ScoreNetwork:
    """The network of a file alone. Raises BadInputError as `load_checkpoint`, and for weights that are not finite."""
    network, _ = load_checkpoint(path)
    require_finite(network, path)
    return network


def require_finite(network: ScoreNetwork, path: str | Path) -> None:
    """Raises BadInputError when a weight of the network of a file is NaN or infinite."""
    if not all(bool(torch.isfinite(parameter).all()) for parameter in network.parameters()):
        raise BadInputError(f"{path} holds weights that are not finite (a diverged training): use another one")


def start_from(network: ScoreNetwork, path: str | Path) -> None:
    """Gives a network the weights of a file, however it detects; a covariance head of one alone stays or goes.

    Raises BadInputError where the file is of another network, or can't be used.
    """
    other = load_network(path)
    names = [name for name in LEARNED if network.config[name] != other.config[name]]
    if names:
        told = ", ".join(f"{name}={other.config[name]} (here {network.config[name]})" for name in names)
        raise BadInputError(f"init={path} is another network, with {told}: give the same model")
    network.load_state_dict(other.state_dict(), strict=False)


def digest_of(network: ScoreNetwork) -> str:
    """Changes when the architecture or a weight of the network does."""
    digest = hashlib.sha256(repr([network.config[name] for name in ARCHITECTURE]).encode())
    for tensor in network.state_dict().values():
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def is_sound(path: Path) -> bool:
    """Whether a ``.ckpt`` file is whole, by its checksums: PyTorch does not look at them and loads damaged weights."""
    try:
        with zipfile.ZipFile(path) as archive:
            return not is_bomb(path, archive.infolist()) and archive.testzip() is None
    except Exception:  # damaged bytes make it raise almost anything
        return False


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """All that a ``.ckpt`` file holds, on the CPU. Raises BadInputError when it can't be read."""
    try:
        if not is_sound(Path(path)):
            raise ValueError("a checksum is wrong")
        checkpoint: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        weights = checkpoint["state_dict"].items()
        if not all(isinstance(name, str) and torch.is_tensor(weight) for name, weight in weights):
            raise ValueError("it holds something else than weights")
        checkpoint["hyper_parameters"]
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
    except (OSError, SafetensorError, KeyError, ValueError, RecursionError) as error:
        raise BadInputError(f"{path} can't be read: it is damaged, or was not written by sips-export") from error


def config_json(network: ScoreNetwork, selector: PointSelector) -> str:
    """What a reader needs besides the weights: ``{"network": {...}, "selector": {...}}``, constructor arguments.

    With a recalibration ``"recalibration": {...}`` beside them.
    """
    config: dict[str, Any] = {"network": network.config, "selector": selector.config}
    if selector.recalibration != AS_TRAINED:
        config[RECALIBRATION] = selector.recalibration.config
    return json.dumps(config, sort_keys=True)


def export_safetensors(network: ScoreNetwork, selector: PointSelector, path: Path) -> list[Path]:
    """Writes the weights with the configuration as metadata, and the configuration again as ``<stem>.json``.

    Returns both paths. Raises BadInputError when they cannot be written.
    """
    config = config_json(network, selector)
    weights = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    sidecar = path.with_suffix(".json")
    write_whole(path, save(weights, {METADATA_KEY: config}))
    write_whole(sidecar, f"{config}\n".encode())
    return [path, sidecar]
