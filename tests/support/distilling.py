"""A tiny distillation: a teacher with something to teach, crops, and a student."""

from functools import partial
from pathlib import Path

import torch
from textured_scenes import flight

from sips_lit.describe.sift import RootSift
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.inliers.klt import KltInliers
from sips_lit.train.crop_datamodule import CropDataModule
from sips_lit.train.distill import DistillModule


def teacher() -> ScoreNetwork:
    """Untrained, but with logits that differ from pixel to pixel."""
    torch.manual_seed(5)
    network = ScoreNetwork(4, 6)
    with torch.no_grad():
        network.layers[-1].weight.mul_(30)
    return network.eval()


def distilling(network: ScoreNetwork | None = None, **options) -> DistillModule:
    torch.manual_seed(0)
    options = {"optimizer": partial(torch.optim.Adam, lr=1e-2), "points": 40, **options}
    return DistillModule(network or ScoreNetwork(3, 4), PointSelector(3), teacher(), **options)


def crops(tmp_path: Path, **options) -> CropDataModule:
    options = {"val_fraction": 0.4, "val_pairs": 2, "loading_workers": 0, "crops": 2, "size": 32, **options}
    return CropDataModule([flight(12, size=(96, 80))], RootSift(), KltInliers(), tmp_path / "indexes", **options)
