"""Training with several scales, turned and scaled images, and labels that know of scales."""

import copy

import cv2
import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight, texture
from train_run import fit

from sips_lit.describe.sift import RootSift
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.train.augment import Augmentation
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.loader import LabelledPair
from sips_lit.train.module import SipsModule

AUGMENTATION = Augmentation(photometric=0, rotation=0.4, log2_scale=0.5)  # the descriptor is upright


class Zooms(ArraySequence):
    """One texture at three sizes, in no order, with known homographies."""

    temporal = False


def zooms() -> Zooms:
    full = texture(160, 200)
    frames = [cv2.resize(full, (w, h), interpolation=cv2.INTER_AREA) for w, h in ((200, 160), (140, 112), (100, 80))]
    scales = [frame.shape[1] / 200 for frame in frames]
    return Zooms(frames, "zooms", [np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1.0]]) for s in scales])


class Watched(SipsModule):
    """Keeps the pairs that it is trained with."""

    def training_step(self, pair: LabelledPair, batch_idx: int) -> torch.Tensor:
        self.seen = [*getattr(self, "seen", []), pair]
        return super().training_step(pair, batch_idx)


def make_module(scales: int) -> Watched:
    torch.manual_seed(0)
    network = ScoreNetwork(3, 4, scales=scales)
    return Watched(network, PointSelector(3), lambda parameters: torch.optim.Adam(parameters, lr=1e-2), points=120)


@pytest.mark.parametrize("scales", [1, 5])
def test_training_runs_on_planar_pairs_with_turns_and_scales(tmp_path, scales):
    module = make_module(scales)
    before = copy.deepcopy(module.network.state_dict())
    options = {"loading_workers": 0, "labelling_workers": 1, "val_pairs": 2}
    data = PairDataModule(
        [flight(8), zooms()],
        RootSift(),
        HomographyInliers(),
        tmp_path,
        val_data=[flight(6, seed=5, name="val")],
        augmentation=AUGMENTATION,
        **options,
    )
    fit(module, data, steps=5)
    assert all((before[name] != value).any() for name, value in module.network.state_dict().items())
    assert len({tuple(pair.image0.shape) for pair in module.seen}) == 5  # turned and scaled
    levels = np.concatenate([pair.points0.level for pair in module.seen])
    assert set(levels.tolist()) == set(range(scales))
    inlier = np.concatenate([pair.labels0.inlier for pair in module.seen])
    assert 0 < inlier.mean() < 0.9
    if scales > 1:
        assert inlier[levels > 0].any()  # coarse points get labels of both kinds, too
        assert not inlier[levels > 0].all()


def test_only_sources_that_a_homography_labels_are_turned(tmp_path):
    planar, video = flight(8, name="planar"), flight(8, seed=2, name="video")
    data = PairDataModule(
        [Source([planar], 1.0, HomographyInliers(), "planar"), Source([video], 1.0, KltInliers(), "video")],
        RootSift(),
        KltInliers(),
        tmp_path,
        val_data=[flight(6, seed=5, name="val")],
        augmentation=AUGMENTATION,
        loading_workers=0,
        labelling_workers=1,
        val_pairs=1,
    )
    module = make_module(1)
    fit(module, data, steps=8)
    shapes = {at: {tuple(pair.image0.shape[-2:]) for pair in module.seen if pair.source == at} for at in (0, 1)}
    assert shapes[1] == {(120, 160)}
    assert (120, 160) not in shapes[0]
    assert shapes[0]
