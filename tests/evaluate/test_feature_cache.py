import dataclasses

import numpy as np
import pytest
from textured_scenes import keypoints, texture
from tiny_network import tiny_network

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.orb import OrbDescriptor
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import FeatureCache, extract, image_key
from sips_lit.evaluate.method import Method
from sips_lit.types import Keypoints

IMAGE = texture(90, 120)
KEY = image_key(IMAGE)


def method(detector=None, descriptor=None, **signature) -> Method:
    return Method("key", "Name", detector or ShiTomasi(), descriptor or RootSift(), signature)


def never():
    raise AssertionError("the image is read although its features are stored")


@pytest.mark.parametrize(
    ("detector", "descriptor"),
    [(ShiTomasi(), RootSift()), (SiftDetector(), None), (ShiTomasi(), OrbDescriptor())],
    ids=lambda part: type(part).__name__,
)
def test_what_is_stored_is_what_was_computed(tmp_path, detector, descriptor):
    who = Method("key", "Name", detector, descriptor, {})
    first = FeatureCache(tmp_path, who, 30)(KEY, lambda: IMAGE)
    stored = FeatureCache(tmp_path, who, 30)(KEY, never)
    expected = extract(detector, descriptor, IMAGE, 30).features
    for one in (first.features, stored.features):
        np.testing.assert_array_equal(one.keypoints.xy, expected.keypoints.xy)
        np.testing.assert_array_equal(one.keypoints.score, expected.keypoints.score)
        np.testing.assert_array_equal(one.keypoints.scale, expected.keypoints.scale)
        np.testing.assert_array_equal(one.descriptors, expected.descriptors)
        assert one.descriptors.dtype == expected.descriptors.dtype
        assert one.norm == expected.norm
    assert stored.defects == first.defects
    assert stored.milliseconds == first.milliseconds
    assert set(stored.milliseconds) == ({"detect"} if descriptor is None else {"detect", "describe"})
    assert all(value > 0 for value in stored.milliseconds.values())


def test_anything_else_is_computed_anew(tmp_path):
    cache = FeatureCache(tmp_path, method(size=8), 30)
    cache(KEY, lambda: IMAGE)
    others = [
        FeatureCache(tmp_path, method(size=9), 30),
        FeatureCache(tmp_path, method(size=8, weights="x"), 30),
        FeatureCache(tmp_path, method(size=8), 31),
    ]
    assert len({cache.folder, *(other.folder for other in others)}) == 4
    for other in others:
        with pytest.raises(AssertionError, match="is read"):
            other(KEY, never)


def test_the_key_tells_images_apart():
    changed = IMAGE.copy()
    changed[3, 4] += 1
    assert len({KEY, image_key(changed), image_key(IMAGE.reshape(120, 90)), image_key(IMAGE.T)}) == 4
    assert image_key(np.asfortranarray(IMAGE)) == KEY


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:200] + b"x" + b[201:]])
def test_a_damaged_file_is_computed_again(tmp_path, damage):
    cache = FeatureCache(tmp_path, method(), 30)
    before = cache(KEY, lambda: IMAGE)
    file = cache.folder / f"{KEY}.npz"
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    after = cache(KEY, lambda: IMAGE)
    np.testing.assert_array_equal(after.features.descriptors, before.features.descriptors)
    assert cache(KEY, never).features.keypoints.xy.shape == before.features.keypoints.xy.shape


def test_a_kill_leaves_what_was_finished(tmp_path):
    """A process that dies while it writes leaves a temporary file, which nobody reads."""
    cache = FeatureCache(tmp_path, method(), 30)
    cache(KEY, lambda: IMAGE)
    other = texture(90, 120, 1)
    (cache.folder / f".{image_key(other)}.npz.1.tmp").write_bytes(b"half")
    assert len(cache(image_key(other), lambda: other).features) == 30
    cache(KEY, never)


class Broken:
    """Returns everything that must not be."""

    name, describes = "Broken", False

    def detect(self, image, n):
        xy = [[10, 10], [10, 10], [np.nan, 5], [500, 5], [20, 30], [40, 30]]
        points = keypoints(xy, [0.5, 0.5, 0.9, 0.8, 0.2, 0.7])
        return Keypoints(points.xy[: n + 6], points.score, points.scale)


def test_defects_are_mended_counted_and_stored(tmp_path):
    cache = FeatureCache(tmp_path, method(Broken()), 10)
    computed, stored = cache(KEY, lambda: IMAGE), cache(KEY, never)
    np.testing.assert_array_equal(stored.features.keypoints.xy, [[40, 30], [10, 10], [20, 30]])
    counts = dataclasses.asdict(stored.defects)
    wrong = {name: counts[name] for name in ("returned", "invalid", "outside", "duplicates", "kept", "missing")}
    assert wrong == {"returned": 6, "invalid": 1, "outside": 1, "duplicates": 1, "kept": 3, "missing": 7}
    assert counts["unsorted"] == counts["short"] == 1
    assert stored.defects == computed.defects


def test_no_points(tmp_path):
    flat = np.full((60, 60), 9, np.uint8)
    cache = FeatureCache(tmp_path, method(), 10)
    for read in (lambda: flat, never):
        assert len(cache(image_key(flat), read).features) == 0


def test_a_folder_that_can_not_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot make the folder"):
        FeatureCache(tmp_path / "file", method(), 10)(KEY, lambda: IMAGE)


def test_covariances_are_kept(tmp_path):
    detector = SipsDetector(tiny_network(covariance=True), PointSelector())
    cache = FeatureCache(tmp_path, method(detector), 10)
    first, stored = cache(KEY, lambda: IMAGE), cache(KEY, never)
    np.testing.assert_array_equal(first.features.keypoints.covariance, stored.features.keypoints.covariance)
    assert stored.features.keypoints.covariance.shape == (10, 2, 2)
