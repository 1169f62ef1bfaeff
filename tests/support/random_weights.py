"""Files of weights in the published layouts, with random numbers: what learned baselines need to run at all."""

from collections.abc import Mapping
from pathlib import Path

import pytest
import torch
from torch import Tensor

from sips_lit.baselines.raco import RaCoNetwork
from sips_lit.baselines.superpoint import SuperPointNetwork


def weights_file(name: str, folder: Path) -> Path:
    """Writes the file of one baseline (``aliked``: t16; ``aliked_n16``: n16); skips where kornia is needed and missing."""
    torch.manual_seed(0)
    path = folder / f"{name}.pth"
    torch.save(_held(name), path)
    return path


def _held(name: str) -> Mapping[str, object]:
    if name.startswith("superpoint"):
        rpautrat = name.endswith("rpautrat")
        weights = SuperPointNetwork(rpautrat).state_dict()
        return {rpautrat_name(key): value for key, value in weights.items()} if rpautrat else weights
    if name == "raco":
        return RaCoNetwork().state_dict() | {"covariance_estimator_head.6.bias": torch.zeros(3)}  # and four more
    kornia = pytest.importorskip("kornia.feature", reason="kornia is missing: pip install 'sips_lit[baselines]'")
    if name.startswith("aliked"):
        network = kornia.ALIKED("aliked-" + (name.partition("_")[2] or "t16"))
        return {key: value for key, value in network.state_dict().items() if key != "dkd.hw_grid"}
    if name.startswith("dedode"):
        from kornia.feature.dedode.dedode_models import get_descriptor, get_detector

        return dict((get_descriptor("B") if name.endswith("descriptor") else get_detector()).state_dict())
    if name == "disk":
        return {"extractor": kornia.DISK().state_dict()}
    if name == "keynet":
        weights = kornia.KeyNet(pretrained=False).state_dict()
        weights["last_conv.0.bias"] += 1  # its responses are cut at zero
        return {"state_dict": weights}
    weights: dict[str, Tensor] = kornia.XFeat().net.state_dict()
    return weights


def rpautrat_name(key: str) -> str:
    """``conv3b.weight`` as rpautrat/SuperPoint calls it: ``backbone.2.1.conv.weight``."""
    layer, parameter = key.split(".")
    kind, stage, part = layer[:-2], layer[-2], "ab".index(layer[-1])
    heads = {"P": "detector", "D": "descriptor"}
    where = f"{heads[stage]}.{part}" if stage in heads else f"backbone.{int(stage) - 1}.{part}"
    return f"{where}.{kind}.{parameter}"
