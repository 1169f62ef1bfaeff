from types import SimpleNamespace

import pytest
import torch
from textured_scenes import ArraySequence, flight, texture
from train_data import DATA, ready

from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.train.crop_datamodule import CropDataModule


class Photographs(ArraySequence):
    temporal = False


STILLS = Photographs([texture(60 + 9 * i, 90 - 7 * i, i) for i in range(8)], "stills")


def module(tmp_path, data=DATA, **options) -> CropDataModule:
    options = {"val_fraction": 0.3, "val_pairs": 3, "loading_workers": 0, "crops": 3, "size": 32, **options}
    return CropDataModule(data, RootSift(), options.pop("inliers", KltInliers()), tmp_path / "indexes", **options)


def batches(data: CropDataModule, **options) -> list:
    ready(data, **options)
    data.trainer.lightning_module = SimpleNamespace(margin=7)
    return list(data.train_dataloader())


def test_a_step_is_a_batch_of_crops_of_training_frames(tmp_path):
    data = module(tmp_path)
    loaded = batches(data, max_steps=5, accumulate=2)
    assert len(loaded) == 10
    assert {tuple(batch.images.shape) for batch in loaded} == {(3, 1, 46, 46)}
    assert {name.split(":")[0] for batch in loaded for name in batch.names} == {"a_0to10", "b_0to8"}
    assert len(data.val_choices) == 3


def test_photographs_of_any_size_train_where_others_validate(tmp_path):
    loaded = batches(module(tmp_path, [STILLS], val_data=DATA), max_steps=12)
    assert {name for batch in loaded for name in batch.names} == {f"stills:{i}" for i in range(8)}
    assert not list((tmp_path / "indexes").glob("*stills*"))  # nothing is measured of them


def test_photographs_alone_can_not_validate(tmp_path):
    with pytest.raises(BadInputError, match=r"stills.* are in no order, .* data@val_data=video"):
        module(tmp_path, [STILLS])
    plane = Photographs(flight(12, size=(96, 80)).frames, "plane", flight(12, size=(96, 80)).to_frame)
    module(tmp_path, [Source([plane], inliers=HomographyInliers())]).prepare_data()


@pytest.mark.parametrize("options", [{"crops": 0}, {"size": 0}])
def test_there_is_something_to_learn_from(tmp_path, options):
    with pytest.raises(BadInputError, match=r"datamodule\.crops and datamodule\.size are 1 or more"):
        module(tmp_path, **options)


def test_only_crops_go_to_the_device(tmp_path):
    data = module(tmp_path)
    (batch,) = batches(data, max_steps=1)
    assert data.transfer_batch_to_device(batch, torch.device("meta"), 0).images.is_meta
    packed = {"pixels": torch.zeros(2)}
    assert data.transfer_batch_to_device(packed, torch.device("meta"), 0) is packed
