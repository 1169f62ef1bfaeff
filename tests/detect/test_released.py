"""Weights that come with the package."""

import cv2
import numpy as np
import pytest

from sips_lit.datasets.demo import demo_stills
from sips_lit.detect import released
from sips_lit.detect.checkpoint import load_checkpoint, load_network
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.released import DEFAULT, SHA256, WEIGHTS, checkpoint_file
from sips_lit.errors import BadInputError

NAMES = sorted(SHA256)


@pytest.mark.parametrize("name", NAMES)
def test_each_is_small_finite_and_has_a_card(name):
    path = checkpoint_file(name)
    assert path.stat().st_size < 1e6
    load_network(name)
    card = (WEIGHTS / f"{name}.md").read_text()
    assert SHA256[name] in card
    for heading in ("## Data and licences", "## Recipe", "## Measured", "## Limits"):
        assert heading in card


def test_there_is_no_file_without_a_name():
    assert {path.stem for path in WEIGHTS.glob("*.safetensors")} == set(SHA256)


@pytest.mark.parametrize("name", NAMES)
def test_best_points_are_found_again_in_a_turned_photograph(name):
    """By a known rotation of 10 degrees about the middle."""
    ((_, image),) = demo_stills(["brick"])
    height, width = image.shape
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 10, 1)
    turned = cv2.warpAffine(image, turn, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT)
    detector = SipsDetector.from_pretrained(name)
    moved = detector(image, n=50).xy @ turn[:, :2].T + turn[:, 2]
    there = detector(turned, n=100).xy
    near = np.linalg.norm(moved[:, None] - there[None], axis=2).min(1) < 2
    assert near.mean() > 0.7


def test_the_default_is_taken_by_name_and_by_path():
    by_name, by_path = SipsDetector.from_pretrained(), SipsDetector.from_checkpoint(WEIGHTS / f"{DEFAULT}.safetensors")
    image = np.random.default_rng(0).integers(0, 255, (80, 90), np.uint8)
    np.testing.assert_array_equal(by_name(image).xy, by_path(image).xy)
    assert SipsDetector.from_pretrained(scales=3).network.scales == 3


@pytest.mark.parametrize(("name", "first", "octaves"), [("sips-tiny", 1, 2), ("sips-small", 0.5, 3)])
def test_they_see_less_than_an_image_and_all_of_a_small_one(name, first, octaves):
    ((_, image),) = demo_stills(["brick"])
    as_released = SipsDetector.from_pretrained(name)
    assert as_released.network.detection.first_octave == first
    whole = {"octaves": octaves, "first_octave": 0, "fine_corners": 0}
    for part, options in ((image, {"whole_below": 0}), (image[:240, :320], whole)):
        expected = SipsDetector.from_pretrained(name, **options)(part)
        np.testing.assert_array_equal(as_released(part).xy, expected.xy)
    assert not np.array_equal(as_released(image).xy, SipsDetector.from_pretrained(name, **whole)(image).xy)


def test_altered_or_missing_weights_are_refused(tmp_path, monkeypatch):
    whole = checkpoint_file(DEFAULT).read_bytes()
    monkeypatch.setattr(released, "WEIGHTS", tmp_path)
    with pytest.raises(BadInputError, match=f"the weights {DEFAULT} can't be read"):
        load_checkpoint(DEFAULT)
    (tmp_path / f"{DEFAULT}.safetensors").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(BadInputError, match="is not what was released"):
        load_checkpoint(DEFAULT)


def test_other_names():
    with pytest.raises(BadInputError, match="no released weights sips-huge: give one of sips-small"):
        SipsDetector.from_pretrained("sips-huge")
    with pytest.raises(BadInputError, match=r"there is no checkpoint sips-huge: .* released weights \(sips-small"):
        load_checkpoint("sips-huge")
