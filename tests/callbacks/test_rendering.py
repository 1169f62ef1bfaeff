from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import torch
from textured_scenes import flight
from validation_pairs import Module, validate, verified

from sips_lit.callbacks.rendering import MatchPictures
from sips_lit.detect.selection import score_map


def test_pictures_of_the_first_pairs(shown, tmp_path):
    validate(MatchPictures(2, 20, tmp_path / "new"), verified(30), verified(0, seed=1), verified(3, seed=2))
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["matches_0.png", "matches_1.png"]
    assert [(name, step) for name, step, _ in shown] == [("val/pair_0", 12), ("val/pair_1", 12)]
    for index in range(2):
        picture = cv2.imread(str(tmp_path / "new" / f"matches_{index}.png"))
        assert picture.shape == shown[index][2].shape
        assert picture.shape[1] >= 2 * 120
        assert picture.std() > 10


def test_a_picture_has_the_name_of_its_pair(shown):
    for name in ("street:3-9", "street:3-8"):
        pair = verified(30)
        validate(MatchPictures(1, 20), replace(pair, pair=replace(pair.pair, name=name)))
    first, second = (picture for _, _, picture in shown)
    changed = np.flatnonzero(np.any(first != second, axis=(1, 2)))
    assert len(changed) > 0
    assert changed[0] >= 2 * 90  # beneath images and score maps


def test_pictures_without_points_or_folder(shown, tmp_path):
    validate(MatchPictures(1, 20, None), verified(0, n=0))
    assert len(shown) == 1
    assert list(tmp_path.iterdir()) == []


def test_other_processes_draw_nothing(shown, tmp_path):
    trainer = SimpleNamespace(global_step=1, is_global_zero=False, loggers=[])
    MatchPictures(2, 20, tmp_path).on_validation_batch_end(trainer, Module(), verified(3), None, 0)
    assert shown == []
    assert list(tmp_path.iterdir()) == []


def test_a_score_map_holds_the_probabilities_of_every_pixel():
    module, image = Module(), flight(1, size=(50, 40)).frames[0]
    scores = score_map(module.network, image)
    expected = torch.sigmoid(module.network(torch.from_numpy(image)[None, None].float()))[0, 0]
    assert scores.shape == image.shape
    np.testing.assert_allclose(scores, expected.detach().numpy(), rtol=1e-6)
