"""An untrained detector that is small enough for tests, and its checkpoint as training writes it."""

from pathlib import Path
from typing import Any

import torch

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector


def tiny_network(seed: int = 0, **parameters: Any) -> ScoreNetwork:
    torch.manual_seed(seed)
    return ScoreNetwork(3, 4, **parameters).eval()


def tiny_detector(**selector: Any) -> SipsDetector:
    return SipsDetector(tiny_network(), PointSelector(**selector))


def lightning_content(network: ScoreNetwork, selector: PointSelector) -> dict[str, Any]:
    """What matters of a Lightning checkpoint, beside things that do not."""
    weights = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    return {
        "epoch": 3,
        "state_dict": {**weights, "other.weight": torch.zeros(2)},
        "hyper_parameters": {"network": dict(network.config), "selector": selector.config},
    }


def save_lightning(path: Path, network: ScoreNetwork, selector: PointSelector) -> Path:
    torch.save(lightning_content(network, selector), path)
    return path
