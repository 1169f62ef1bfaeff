import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stereo_scenes import BASELINE, FOCAL, StereoScene
from textured_scenes import texture

from sips_lit.datasets.euroc import euroc
from sips_lit.datasets.kitti import kitti
from sips_lit.errors import BadInputError
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.types import GreyImage

WIDTH, HEIGHT = 400, 150
LEFT = texture(HEIGHT, WIDTH, 1)
MATCHER = StereoMatcher(max_disparity=100)


def shifted(image: GreyImage, disparity: float) -> GreyImage:
    return cv2.warpAffine(
        image, np.array([[1.0, 0, -disparity], [0, 1, 0]]), image.shape[::-1], flags=cv2.INTER_LANCZOS4
    )


def points(count: int, low: float, high: float = WIDTH - 6, seed: int = 0) -> np.ndarray:
    """Anywhere between pixels, from column ``low`` on."""
    return np.random.default_rng(seed).uniform([low, 1], [high, HEIGHT - 2], (count, 2)).astype(np.float32)


def corners(image: GreyImage, count: int) -> np.ndarray:
    return cv2.goodFeaturesToTrack(image, count, 1e-3, 6).reshape(-1, 2)


@given(st.floats(0.3, 95), st.integers(0, 50))
@settings(max_examples=15, deadline=None)
def test_a_known_shift_to_a_fraction_of_a_pixel(disparity, seed):
    found = MATCHER.disparity(LEFT, shifted(LEFT, disparity), points(60, 110, seed=seed))
    assert np.isfinite(found).mean() > 0.95
    error = np.abs(found - disparity)
    assert np.nanmedian(error) < 0.04
    assert np.nanquantile(error, 0.95) < 0.1
    assert np.nanmax(error) < 0.4  # where the texture is cut off at black or white only an edge of the patch tells


def test_the_score_must_be_high_enough():
    """Noise in the partner; the score near the true match, 20 px away, is computed here."""
    noise = np.random.default_rng(0).normal(0, 60, LEFT.shape)
    right = np.clip(np.roll(LEFT, -20, axis=1) + noise, 0, 255).astype(np.uint8)
    xy = np.stack(np.meshgrid(np.arange(40, 380, 10), np.arange(10, 140, 10)), -1).reshape(-1, 2)
    smooth = [cv2.blur(image.astype(np.float32), (3, 3)) for image in (LEFT, right)]

    def patch(image: np.ndarray, x: int, y: int) -> np.ndarray:
        return image[y - 4 : y + 5 : 2, x - 4 : x + 5 : 2].ravel()

    def score(x: int, y: int) -> float:
        return max(np.corrcoef(patch(smooth[0], x, y), patch(smooth[1], x - d, y))[0, 1] for d in range(18, 23))

    best = np.array([score(x, y) for x, y in xy])
    others = {"max_disparity": 100, "max_ambiguity": 1e9, "max_roundtrip": 1e9}  # the score alone decides
    found = {
        least: StereoMatcher(min_score=least, **others).disparity(LEFT, right, xy.astype(np.float32))
        for least in (-1.0, 0.7, 0.9)
    }
    near = np.abs(found[-1.0] - 20) < 0.4  # the highest score of all is that of a disparity near 20
    for least in (0.7, 0.9):
        assert np.isnan(found[least][near & (best < least - 0.01)]).all()
        assert np.isfinite(found[least][near & (best > least + 0.01)]).all()
        assert (near & (best < least - 0.01)).sum() > 3
    default = StereoMatcher(**others).disparity(LEFT, right, xy.astype(np.float32))
    np.testing.assert_array_equal(default, found[0.7])


def test_patches_that_vary_by_less_than_one_grey_value_have_nothing_to_match():
    xy = np.stack(np.meshgrid(np.arange(40, 380, 5), np.arange(10, 140, 5)), -1).reshape(-1, 2)
    below = above = 0
    for amplitude in (0.015, 0.02, 0.03, 0.05):
        dull = np.rint(127 + amplitude * (LEFT - 127.0)).astype(np.uint8)
        smooth = cv2.blur(dull.astype(np.float32), (3, 3))
        variation = np.array([smooth[y - 4 : y + 5 : 2, x - 4 : x + 5 : 2].std() for x, y in xy])
        found = MATCHER.disparity(dull, np.roll(dull, -20, axis=1), xy.astype(np.float32))
        assert np.isnan(found[variation < 0.99]).all()
        below += ((variation > 0.85) & (variation < 0.99)).sum()
        above += (np.isfinite(found) & (variation < 1.2)).sum()
    assert min(below, above) > 20  # both sides were tried


@pytest.mark.parametrize(("beyond", "known"), [(0.0, True), (0.1, False)])
def test_points_nearer_than_four_pixels_to_the_border_are_not_known(beyond, known):
    rows = np.arange(10, 140, 10)
    left, right = (np.stack([np.full(len(rows), x), rows], 1) for x in (4 - beyond, WIDTH - 5 + beyond))
    for found in (
        MATCHER.disparity(LEFT, np.roll(LEFT, 20, axis=1), left, to_the_right=False),
        MATCHER.disparity(LEFT, np.roll(LEFT, -20, axis=1), right),
    ):
        assert np.isfinite(found).mean() > 0.8 if known else np.isnan(found).all()


def test_changed_light_does_not_matter():
    right = np.clip(0.7 * shifted(LEFT, 20.4) + 40.0, 0, 255).astype(np.uint8)
    found = MATCHER.disparity(LEFT, right, points(100, 60))
    assert np.isfinite(found).mean() > 0.95
    assert np.nanmedian(np.abs(found - 20.4)) < 0.04


def test_a_mirror_swaps_the_sides():
    scene = StereoScene(1)
    left, right, xy = scene.frames[0], scene.rights[0], corners(scene.frames[0], 150)
    mirrored = np.column_stack([left.shape[1] - 1 - xy[:, 0], xy[:, 1]])
    straight = MATCHER.disparity(left, right, xy)
    turned = MATCHER.disparity(
        np.ascontiguousarray(left[:, ::-1]), np.ascontiguousarray(right[:, ::-1]), mirrored, to_the_right=False
    )
    np.testing.assert_allclose(turned, straight, atol=5e-3)
    wrong_way = MATCHER.disparity(left, right, xy, to_the_right=False)
    assert np.isfinite(wrong_way).mean() < 0.15
    assert np.isfinite(straight).mean() > 0.7


def test_boards_at_known_depths():
    scene = StereoScene(1)
    xy = corners(scene.frames[0], 300)
    column, row = np.round(xy).astype(int).T
    truth = FOCAL * BASELINE / scene.depths[0][row, column]
    found = MATCHER.disparity(scene.frames[0], scene.rights[0], xy)
    error = np.abs(found - truth)
    assert np.isfinite(found).mean() > 0.7
    assert np.nanmedian(error) < 0.1
    assert (error > 1).sum() < 0.05 * np.isfinite(found).sum()  # corners at a board's edge belong to either side


def test_what_only_the_left_camera_sees_is_unknown():
    right = shifted(LEFT, 30)
    right[:, :120] = texture(HEIGHT, 120, 9)
    found = MATCHER.disparity(LEFT, right, points(200, 40, 130))
    assert np.isnan(found).mean() > 0.7  # chance finds some place that looks alike


def test_repeated_texture_is_unknown():
    stripes = np.tile(texture(HEIGHT, 25, 3), (1, 16))
    assert np.isnan(MATCHER.disparity(stripes, np.roll(stripes, -10, 1), points(50, 130))).all()


def test_nothing_to_match_is_unknown():
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert np.isnan(MATCHER.disparity(flat, flat, points(20, 110))).all()
    rows = np.repeat(texture(HEIGHT, 1, 2), WIDTH, 1)  # edges along the row: every disparity is as good
    assert np.isnan(MATCHER.disparity(rows, rows, points(20, 110))).all()


def test_far_points_and_too_near_ones_are_unknown():
    assert np.isnan(MATCHER.disparity(LEFT, shifted(LEFT, 0.1), points(50, 110))).all()
    near = StereoMatcher(max_disparity=40).disparity(LEFT, shifted(LEFT, 60), points(50, 110))
    assert np.isnan(near).mean() > 0.8


def test_borders_and_outside():
    edges = [[1, 60], [WIDTH - 2, 60], [-50, 60], [WIDTH + 50, 60], [200, 0], [200, HEIGHT - 1], [15, 60]]
    found = MATCHER.disparity(LEFT, shifted(LEFT, 20), np.array(edges))
    assert np.isnan(found[[0, 1, 2, 3, 6]]).all()  # the last one's place is outside the right image
    np.testing.assert_allclose(found[4:6], 20, atol=0.1)  # rows may end: they do so in both images


def test_no_points_and_many():
    assert MATCHER.disparity(LEFT, LEFT, np.zeros((0, 2))).shape == (0,)
    xy, right = points(700, 110), shifted(LEFT, 12.3)  # more than are taken at a time
    together = MATCHER.disparity(LEFT, right, xy)
    apart = np.concatenate([MATCHER.disparity(LEFT, right, xy[i : i + 1]) for i in range(0, 700, 70)])
    np.testing.assert_allclose(together[::70], apart, atol=1e-4)


def test_images_smaller_than_a_patch():
    tiny = texture(5, 7, 0)
    assert np.isnan(MATCHER.disparity(tiny, tiny, np.array([[3, 2]]))).all()


def semi_global(left: GreyImage, right: GreyImage) -> np.ndarray:
    """OpenCV's dense disparity, NaN where unknown."""
    wide = [cv2.copyMakeBorder(image, 0, 0, 192, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    matcher = cv2.StereoSGBM_create(0, 192, 5, 200, 800, 1, 63, 10, 100, 2)
    disparity = matcher.compute(*wide)[:, 192:] / 16
    return np.where(disparity > 0.5, disparity, np.nan)


@pytest.mark.shared_data
@pytest.mark.parametrize("data", ["kitti_odometry", "euroc_v1_01_excerpt"])
def test_agrees_with_dense_stereo_on_photographs(shared_data, data):
    if not (shared_data / data).is_dir():
        pytest.skip(f"no {data} in ../shared/data")
    try:
        sequence = (kitti if data.startswith("kitti") else euroc)(shared_data / data)[0]
    except BadInputError as reason:
        pytest.skip(str(reason))
    errors, found = [], []
    for index in (2, len(sequence) // 2, len(sequence) - 3):
        left, right = sequence.frame(index), sequence.right(index)
        assert right is not None
        xy = corners(left, 400)
        own = StereoMatcher().disparity(left, right, xy)
        column, row = np.round(xy).astype(int).T
        found.append(np.isfinite(own))
        errors.append(np.abs(own - semi_global(left, right)[row, column]))
    error = np.concatenate(errors)
    error = error[np.isfinite(error)]
    assert np.mean(found) > 0.6
    assert np.median(error) < 0.3
    assert (error > 1).mean() < 0.06
