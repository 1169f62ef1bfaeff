"""Frames that can't be read, from the data to the pairs that train and validate."""

import re

import pytest
from textured_scenes import Damaged, flight
from train_data import module, ready

from sips_lit.errors import BadInputError
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.train.dataset import unpack


def damaged(bad: tuple[int, ...], planar: bool = False) -> Damaged:
    whole = flight(24, size=(96, 80), known=planar)
    sequence = Damaged(whole.frames, "walk", whole.to_frame)
    sequence.bad = bad
    return sequence


def spans(pairs) -> list[tuple[int, int]]:
    return [tuple(sorted(map(int, pair.name.split(":")[1].split("-")))) for pair in pairs]


def test_no_pair_reaches_across_an_unreadable_frame(tmp_path, capsys):
    data = ready(module(tmp_path, [damaged((5, 9, 20))]), max_steps=30)  # of 24: 17 train, 7 validate
    trained = spans(data.train_dataloader())
    validated = spans(unpack(packed).pair for packed in data.val_dataloader())
    assert len(validated) == 5
    assert not [span for span in trained for bad in (5, 9) if span[0] <= bad <= span[1]]
    assert not [span for span in validated if span[0] <= 20 - 17 <= span[1]]
    assert data.skipped.count == 0  # the index knew
    warned = capsys.readouterr().err.splitlines()
    left_out = "can't be read and are left out"
    assert f"warning: frames of the training data {left_out} (2); the first: 5.png is damaged" in warned
    assert f"warning: frames of the validation data {left_out} (1); the first: 20.png is damaged" in warned


def test_validation_pairs_that_the_index_did_not_see_are_tried(tmp_path, capsys):
    # the overlap of planar scenes is known without reading their frames
    data = ready(module(tmp_path, [damaged((19,), planar=True)], inliers=HomographyInliers(), val_pairs=15))
    validated = [unpack(packed).pair for packed in data.val_dataloader()]
    assert len(validated) == 15  # of the six frames that can be read
    assert not [pair for pair in validated if 19 - 17 in (pair.index0, pair.index1)]
    assert re.search(
        r"validation pairs can't be read and are left out \(\d+\); the first: 19\.png", capsys.readouterr().err
    )


def test_no_validation_pair_can_be_read(tmp_path):
    data = module(tmp_path, [damaged((18, 19, 20, 21, 22, 23), planar=True)], inliers=HomographyInliers())
    data.prepare_data()
    with pytest.raises(BadInputError, match=r"no validation pair can be read; the first: \d\d\.png is damaged"):
        data.setup("fit")
