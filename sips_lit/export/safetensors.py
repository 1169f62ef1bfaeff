"""Weights as safetensors: a file that cannot run code, which every command takes as a checkpoint."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from safetensors.torch import save

from sips_lit.detect.checkpoint import METADATA_KEY
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.files import write_whole


def config_json(network: ScoreNetwork, selector: PointSelector) -> str:
    """What a reader needs besides the weights: ``{"network": {...}, "selector": {...}}``, constructor arguments."""
    return json.dumps({"network": network.config, "selector": asdict(selector)}, sort_keys=True)


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
