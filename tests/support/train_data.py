from types import SimpleNamespace

import numpy as np
from textured_scenes import flight

from sips_lit.describe.sift import RootSift
from sips_lit.detect.selection import SelectedPoints
from sips_lit.inliers.klt import KltInliers
from sips_lit.train.datamodule import PairDataModule
from sips_lit.types import Keypoints

DATA = [flight(14, size=(96, 80), name="a"), flight(12, size=(96, 80), seed=3, name="b")]


def no_points(images):
    none = np.zeros(0, np.int64)
    return [SelectedPoints(Keypoints.empty(), none, none, none) for _ in images]


def module(tmp_path, data=DATA, **options) -> PairDataModule:
    options = {"val_fraction": 0.3, "val_pairs": 5, "loading_workers": 0, "overlap": 0.2, **options}
    return PairDataModule(data, RootSift(), options.pop("inliers", KltInliers()), tmp_path / "indexes", **options)


def trainer(max_steps=6, accumulate=1, rank=0, ranks=1):
    """What the DataModule asks of a trainer."""
    return SimpleNamespace(
        max_steps=max_steps,
        accumulate_grad_batches=accumulate,
        world_size=ranks,
        global_rank=rank,
        lightning_module=SimpleNamespace(select_to_train=no_points, pairs_at_once=1),
    )


def ready(module: PairDataModule, **options) -> PairDataModule:
    module.prepare_data()
    module.setup("fit")
    module.trainer = trainer(**options)
    return module
