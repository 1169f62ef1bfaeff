import sys

import cv2
import numpy as np
import pytest

from sips_lit.describe.surf import SurfDescriptor
from sips_lit.errors import BadInputError
from sips_lit.types import Keypoints


def test_missing_package_is_one_clear_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "mahotas.features.surf", None)
    with pytest.raises(BadInputError, match=r"pip install 'sips_lit\[surf\]'"):
        SurfDescriptor()


def test_senseless_size_is_refused():
    with pytest.raises(BadInputError, match="size"):
        SurfDescriptor(size=0)


def test_length_is_one_and_a_turned_image_gives_the_same():
    pytest.importorskip("mahotas", reason="the extra 'surf' is not installed")
    noise = np.random.default_rng(0).integers(0, 255, (200, 240)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 4)
    xy = np.random.default_rng(1).integers(60, 140, (30, 2)).astype(np.float32)
    there = np.column_stack([xy[:, 1], image.shape[1] - 1 - xy[:, 0]])
    ones = np.ones(30, np.float32)
    here = SurfDescriptor().describe(image, Keypoints(xy, ones, ones))
    turned = SurfDescriptor().describe(np.ascontiguousarray(np.rot90(image)), Keypoints(there, ones, ones))
    np.testing.assert_allclose(np.linalg.norm(here, axis=1), 1, atol=1e-5)
    similarity = here @ turned.T
    assert (similarity.argmax(axis=1) == np.arange(30)).mean() > 0.6  # 1 in 30 by chance
