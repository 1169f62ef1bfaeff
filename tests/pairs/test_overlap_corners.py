"""Where new points to track are put."""

import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.pairs.overlap import OverlapParameters, corners_to_track


def test_new_points_keep_away_from_the_others_and_from_flat_places():
    image = texture(96, 128)
    image[:, 64:] = 77
    taken = np.array([[10.2, 11.8], [40, 50]], np.float32)
    fresh = corners_to_track(image, taken, OverlapParameters())
    assert 6 < len(fresh) <= 4 * 6 + 6  # cells of the textured half, and those at its edge
    assert fresh[:, 0].max() < 68
    assert np.abs(fresh[:, None] - taken[None]).max(2).min() >= 4
    for cell in ((0, 0), (3, 2)):
        assert cell not in {(int(y // 16), int(x // 16)) for x, y in fresh}


@pytest.mark.parametrize("contrast", [1, 0.5])
def test_only_corners_are_tracked(contrast):
    """A weak texture, as that of a road, and a straight edge, which slides, are no corners, however dark the video is."""
    image = texture(96, 192).astype(np.float32)
    image[:, 64:] = 128 + (image[:, 64:] - 128) / 12
    image[:, 128:] = np.where(np.arange(64) < 32, 90, 160)
    image = (image * contrast).astype(np.uint8)
    nothing = np.zeros((0, 2), np.float32)
    corners, all_places = (corners_to_track(image, nothing, OverlapParameters(quality=q)) for q in (0.03, 0))
    assert len(all_places) > 40
    assert corners[:, 0].max() < 68
    assert len(corners) > 16


@pytest.mark.parametrize("shape", [(2, 2), (5, 40), (15, 15)])
def test_images_smaller_than_a_cell(shape):
    assert corners_to_track(texture(*shape), np.zeros((0, 2), np.float32), OverlapParameters()).shape == (0, 2)


def test_new_points_are_on_the_corners_of_the_image():
    """Bright squares 2 px wide at known places, one in a cell: their middles are between four pixels."""
    image = np.full((64, 128), 40, np.uint8)
    corners = [(20, 10), (54, 38), (100, 22), (116, 52)]
    for x, y in corners:
        image[y : y + 2, x : x + 2] = 240
    found = corners_to_track(image, np.zeros((0, 2), np.float32), OverlapParameters())
    assert len(found) >= 4
    for x, y in corners:
        assert np.abs(found - [x + 0.5, y + 0.5]).max(1).min() <= 2
    assert all(min(np.hypot(px - x, py - y) for x, y in corners) < 4 for px, py in found)


@pytest.mark.parametrize("flip", [np.fliplr, np.flipud])
def test_new_points_of_a_mirrored_image_are_mirrored(flip):
    """A place that is half a pixel off on one side is half a pixel off on the other."""
    image = texture(96, 128)
    nothing = np.zeros((0, 2), np.float32)
    straight, turned = (
        corners_to_track(np.ascontiguousarray(seen), nothing, OverlapParameters()) for seen in (image, flip(image))
    )
    axis = 0 if flip is np.fliplr else 1
    turned[:, axis] = image.shape[1 - axis] - 1 - turned[:, axis]
    assert len(straight) > 30
    assert sorted(turned.tolist()) == sorted(straight.tolist())


def test_one_lamp_does_not_hide_the_corners_of_a_dark_image():
    image = (texture(96, 128) // 8).astype(np.uint8)
    lit = image.copy()
    lit[38:42, 70:74] = 255  # inside a cell
    nothing = np.zeros((0, 2), np.float32)
    dark, bright = ({*map(tuple, corners_to_track(i, nothing, OverlapParameters()).tolist())} for i in (image, lit))
    apart = {place for place in dark if np.hypot(place[0] - 72, place[1] - 40) > 16}
    assert len(apart) > 30
    assert len(apart & bright) >= len(apart) - 2
