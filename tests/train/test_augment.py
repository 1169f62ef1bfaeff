from dataclasses import replace

import cv2
import numpy as np
import pytest
from textured_scenes import flight, keypoints, near_and_far, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import Augmentation, mirror_pair, shrink_images
from sips_lit.types import Camera, FramePair, ViewGeometry

PAIR = read_pair(flight(6), 0, 5)
FLIPS = [(True, False), (False, True), (True, True)]
QUIET = {"contrast": 1.0, "gamma": 1.0, "brightness": 0.0, "noise": 0.0, "blur": 0.0, "shade": 0.0}


def mirrored_points(xy: np.ndarray, horizontal: bool, vertical: bool) -> np.ndarray:
    width, height = PAIR.image0.shape[::-1]
    x = width - 1 - xy[:, 0] if horizontal else xy[:, 0]
    y = height - 1 - xy[:, 1] if vertical else xy[:, 1]
    return np.stack([x, y], 1)


@pytest.mark.parametrize(("horizontal", "vertical"), FLIPS)
def test_mirrors_turn_every_frame_and_the_homography(horizontal, vertical):
    pair = mirror_pair(PAIR, horizontal, vertical)
    for before, after in zip(
        [*PAIR.frames, PAIR.image0, PAIR.image1], [*pair.frames, pair.image0, pair.image1], strict=True
    ):
        np.testing.assert_array_equal(after, cv2.flip(before, {(1, 0): 1, (0, 1): 0, (1, 1): -1}[horizontal, vertical]))
        assert after.flags.c_contiguous
    warped = cv2.warpPerspective(pair.image0, pair.homography, pair.image1.shape[::-1])
    inside = warped > 0
    assert inside.mean() > 0.7
    difference = np.abs(warped.astype(float) - pair.image1)
    assert np.median(difference[inside]) <= 4
    wrong = cv2.warpPerspective(pair.image0, PAIR.homography, pair.image1.shape[::-1]).astype(float)
    assert np.median(np.abs(wrong - pair.image1)) > 10  # the test can tell


@pytest.mark.parametrize(("horizontal", "vertical"), FLIPS)
@pytest.mark.parametrize("check", [KltInliers(), HomographyInliers()])
def test_labels_of_mirrored_points_stay(horizontal, vertical, check):
    start, goal, matches = near_and_far(PAIR)
    before = check(PAIR, keypoints(start), keypoints(goal), matches)
    turned = [keypoints(mirrored_points(xy, horizontal, vertical)) for xy in (start, goal)]
    after = check(mirror_pair(PAIR, horizontal, vertical), *turned, matches)
    assert 20 < before.inlier.sum() < 60
    assert (before.inlier != after.inlier).sum() <= 1  # OpenCV's pyramids are not quite symmetric


def test_images_of_two_sizes():
    image0, image1 = texture(40, 50), texture(60, 45)
    H = np.array([[1.2, 0, 3], [0, 0.9, -4], [0, 0, 1]])
    pair = mirror_pair(FramePair("a:0-1", 0, 1, (image0, image1), image0, image1, H), True, True)
    x, y = apply_homography(H, np.array([[10.0, 20]]))[0]
    np.testing.assert_allclose(apply_homography(pair.homography, np.array([[39.0, 19]])), [[44 - x, 59 - y]])


def test_no_mirror_is_the_same_pair():
    assert mirror_pair(PAIR, False, False) is PAIR
    assert mirror_pair(replace(PAIR, homography=None), True, False).homography is None


def test_a_mirrored_pair_keeps_its_geometry():
    camera = Camera(np.array([[100.0, 0, 70], [0, 100, 50], [0, 0, 1]]), (160, 120))
    T = np.eye(4)
    T[0, 3] = -0.2
    depth = np.random.default_rng(0).uniform(2, 4, (120, 160))
    pair = mirror_pair(replace(PAIR, geometry=ViewGeometry(T, camera, camera, depth, None)), True, False)
    np.testing.assert_array_equal(pair.geometry.depth0, depth[:, ::-1])
    assert pair.geometry.depth1 is None
    assert pair.geometry.T_1_0[0, 3] == pytest.approx(0.2)
    assert pair.geometry.camera0.matrix[0, 2] == pytest.approx(159 - 70)


def test_light_changes_only_what_the_detector_sees():
    pair = Augmentation(flip=0, photometric=1)(PAIR, np.random.default_rng(0))
    assert all(after is before for before, after in zip(PAIR.frames, pair.frames, strict=True))
    np.testing.assert_array_equal(PAIR.image0, flight(6).frames[0])  # the original is not written to
    changes = [np.abs(a.astype(float) - b).mean() for a, b in ((pair.image0, PAIR.image0), (pair.image1, PAIR.image1))]
    assert min(changes) > 1
    assert abs(changes[0] - changes[1]) > 0.1  # each image in its own way
    np.testing.assert_array_equal(pair.homography, PAIR.homography)


def test_switched_off_it_changes_nothing():
    pair = Augmentation(flip=0, photometric=0)(PAIR, np.random.default_rng(0))
    np.testing.assert_array_equal(pair.image0, PAIR.image0)
    quiet = Augmentation(**QUIET).change_light(PAIR.image0, np.random.default_rng(0))
    np.testing.assert_array_equal(quiet, PAIR.image0)


def test_the_same_generator_state_gives_the_same_pair():
    augmentation = Augmentation()
    pairs = [augmentation(PAIR, np.random.default_rng([1, i])) for i in (0, 0, 1)]
    np.testing.assert_array_equal(pairs[0].image0, pairs[1].image0)
    np.testing.assert_array_equal(pairs[0].homography, pairs[1].homography)
    assert (pairs[0].image0 != pairs[2].image0).any()


def test_each_mirror_has_its_probability():
    drawn = [Augmentation(flip=0.25, photometric=0)(PAIR, np.random.default_rng(i)).homography for i in range(300)]
    for flip, probability in (((True, False), 0.1875), ((False, True), 0.1875), ((True, True), 0.0625)):
        expected = mirror_pair(PAIR, *flip).homography
        share = np.mean([np.allclose(H, expected) for H in drawn])
        assert abs(share - probability) < 4 * np.sqrt(probability * (1 - probability) / 300)


@pytest.mark.parametrize("value", [0, 255])
def test_nothing_overflows(value):
    image = np.full((40, 60), value, np.uint8)
    augmentation = Augmentation(contrast=1.1, gamma=1, brightness=60, noise=2, blur=0, shade=0.2)
    for seed in range(40):
        changed = augmentation.change_light(image, np.random.default_rng(seed))
        assert changed.dtype == np.uint8
        assert changed.shape == image.shape
        # a wrap-around would put pixels at the other end of the range
        assert np.ptp(changed) < 120


def test_brighter_places_stay_brighter():
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None], 9, 0)
    augmentation = Augmentation(contrast=3, gamma=3, brightness=100, noise=0, blur=0, shade=0)
    for seed in range(40):
        changed = augmentation.change_light(ramp, np.random.default_rng(seed)).astype(int)
        assert (np.diff(changed, axis=1) >= 0).all()


def test_sizes_of_the_changes():
    image = np.full((80, 90), 128, np.uint8)
    noisy = [Augmentation(**{**QUIET, "noise": 8.0}).change_light(image, np.random.default_rng(i)) for i in range(60)]
    deviations = [float(x.std()) for x in noisy]
    assert max(deviations) < 8.5
    assert np.mean(deviations) == pytest.approx(4, abs=1)
    bright = [
        Augmentation(**{**QUIET, "brightness": 30}).change_light(image, np.random.default_rng(i)) for i in range(60)
    ]
    assert max(abs(float(x.mean()) - 128) for x in bright) <= 30.5
    assert np.std([float(x.mean()) for x in bright]) == pytest.approx(30 / np.sqrt(3), rel=0.3)
    shaded = [Augmentation(**{**QUIET, "shade": 0.5}).change_light(image, np.random.default_rng(i)) for i in range(60)]
    assert max(abs(x.astype(float) / 128 - 1).max() for x in shaded) <= 0.51
    assert max(np.ptp(x) for x in shaded) > 60
    sharp = np.kron(np.indices((20, 20)).sum(0) % 2 * 200, np.ones((2, 2))).astype(np.uint8)
    contrasts = [
        Augmentation(**{**QUIET, "blur": 1.2}).change_light(sharp, np.random.default_rng(i)).std() for i in range(40)
    ]
    assert max(contrasts) == sharp.std()
    assert min(contrasts) < 0.6 * sharp.std()


def test_turns_and_scales_only_of_planar_pairs():
    augmentation = Augmentation(flip=0, photometric=0, rotation=1.0, log2_scale=0.5)
    ends = read_pair(flight(6), 0, 5, between=False)
    camera = Camera(np.eye(3), (160, 120))
    for pair, planar in [
        (ends, False),
        (replace(ends, homography=None), True),
        (replace(ends, geometry=ViewGeometry(np.eye(4), camera, camera, None, None)), True),
    ]:
        after = augmentation(pair, np.random.default_rng(0), planar)
        assert after.image0 is pair.image0
        assert after.homography is pair.homography
    still = Augmentation(flip=0, photometric=0)(ends, np.random.default_rng(0), True)
    assert still.image0 is ends.image0


def test_how_far_it_turns_and_scales():
    ends = read_pair(flight(6), 0, 5, between=False)
    identity = replace(ends, homography=np.eye(3))
    augmentation = Augmentation(flip=0, photometric=0, rotation=0.8, log2_scale=0.5)
    made = [augmentation(identity, np.random.default_rng(i), True).homography for i in range(400)]
    ratio = np.array([np.log2(np.linalg.det(H)) / 2 for H in made])  # of two scales, each from -0.5 to 0.5
    angle = np.array([np.arctan2(H[1, 0], H[0, 0]) for H in made])
    for drawn, most in ((ratio, 1.0), (angle, 1.6)):
        assert 0.85 * most < np.abs(drawn).max() <= most
        assert drawn.std() == pytest.approx(most / np.sqrt(6), rel=0.12)
        assert abs(drawn.mean()) < 0.1 * most


def test_smaller_images_of_frames_that_stay():
    pair = shrink_images(PAIR, 1, 1.5)
    assert (pair.image0 == PAIR.image0).all()
    assert pair.image1.shape == (80, 107)
    np.testing.assert_array_equal(pair.image1, cv2.resize(PAIR.image1, (107, 80), interpolation=cv2.INTER_AREA))
    assert pair.frames is PAIR.frames
    assert pair.homography is PAIR.homography


def test_how_far_images_shrink_together_and_alone():
    def steps(**most: float) -> np.ndarray:
        augmentation = Augmentation(flip=0, photometric=0, **most)
        pairs = [augmentation(PAIR, np.random.default_rng(i)) for i in range(200)]
        return np.log2([[160 / image.shape[1] for image in (pair.image0, pair.image1)] for pair in pairs])

    together, alone = steps(log2_shrink=1), steps(log2_zoom=0.5)
    for drawn, most in ((together, 1), (alone, 0.5)):
        assert drawn.min() >= 0
        assert 0.95 * most < drawn.max() <= most + 0.01
        assert drawn.mean(0) == pytest.approx([most / 2] * 2, abs=0.1 * most)
    assert (together[:, 0] == together[:, 1]).all()
    assert abs(np.corrcoef(alone.T)[0, 1]) < 0.2


def whole_pair() -> FramePair:
    """Two images of other sizes and cameras, a frame between, a homography, a pose, depth maps and partners: all differ."""
    image0, between, image1 = texture(60, 80, 1), texture(60, 80, 2), texture(48, 64, 3)
    camera0 = Camera(np.array([[100.0, 0, 30], [0, 90, 20], [0, 0, 1]]), (80, 60))
    camera1 = Camera(np.array([[70.0, 0, 25], [0, 60, 30], [0, 0, 1]]), (64, 48))
    generator = np.random.default_rng(0)
    depth0, depth1 = (generator.uniform(2, 9, image.shape).astype(np.float32) for image in (image0, image1))
    T = np.eye(4)
    T[:3, 3] = 0.1, 0.2, 0.3
    T[:3, :3] = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))[0]
    geometry = ViewGeometry(T, camera0, camera1, depth0, depth1, texture(60, 80, 4), texture(48, 64, 5), 0.4)
    H = np.array([[0.8, 0.05, 3], [-0.04, 0.7, 2], [1e-4, 0, 1]])
    return FramePair("a:0-2", 0, 2, (image0, between, image1), image0, image1, H, geometry)


def seen(pair: FramePair, image: int, xy: tuple[int, int]) -> np.ndarray:
    """The place in space, in the frame of image 0 or 1, of a pixel with the depth that the map has there."""
    g = pair.geometry
    camera, depth = ((g.camera0, g.depth0), (g.camera1, g.depth1))[image]
    return np.linalg.inv(camera.matrix) @ [*xy, 1] * depth[xy[1], xy[0]]


@pytest.mark.parametrize(("horizontal", "vertical"), FLIPS)
def test_a_mirror_turns_the_world_of_both_images(horizontal, vertical):
    """A point seen in either image is seen in the mirrored one, and its place in space is the mirrored one."""
    pair = whole_pair()
    mirrored, g = mirror_pair(pair, horizontal, vertical), mirror_pair(pair, horizontal, vertical).geometry
    sides = np.array([-1 if horizontal else 1, -1 if vertical else 1, 1])
    for image, (width, height) in enumerate(((80, 60), (64, 48))):
        for x, y in ((5, 7), (50, 40)):
            there = (width - 1 - x if horizontal else x, height - 1 - y if vertical else y)
            np.testing.assert_allclose(seen(mirrored, image, there), sides * seen(pair, image, (x, y)))
    point = np.array([0.5, -0.4, 3])
    moved = pair.geometry.T_1_0 @ [*point, 1]
    np.testing.assert_allclose(g.T_1_0 @ [*(sides * point), 1], [*(sides * moved[:3]), 1])
    rows, columns = slice(None, None, -1 if vertical else 1), slice(None, None, -1 if horizontal else 1)
    for name in ("right0", "right1"):
        np.testing.assert_array_equal(getattr(g, name), getattr(pair.geometry, name)[rows, columns])
    assert g.baseline == (-0.4 if horizontal else 0.4)
    assert (g.camera0.size, g.camera1.size) == ((80, 60), (64, 48))


def test_each_image_changes_in_its_own_way():
    alike = replace(PAIR, image1=PAIR.image0)
    pair = Augmentation(flip=0, photometric=1)(alike, np.random.default_rng(0))
    assert (pair.image0 != pair.image1).mean() > 0.5
    other = replace(PAIR, image1=np.full((50, 70), 9, np.uint8))
    assert Augmentation(flip=0, photometric=1)(other, np.random.default_rng(0)).image1.shape == (50, 70)


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_single_image_is_mirrored_and_transposed_in_all_eight_ways():
    image = texture(40, 50)
    ways = [np.ascontiguousarray(way[::a, ::b]) for way in (image, image.T) for a in (1, -1) for b in (1, -1)]
    change = Augmentation(transpose=0.5)
    seen = {change.change_shape(image, generator(seed)).tobytes() for seed in range(100)}
    assert seen == {way.tobytes() for way in ways}


def test_a_single_image_is_turned_scaled_and_shrunk_within_the_ranges():
    image = texture(60, 80)
    turned = {Augmentation(flip=0, log2_scale=1).change_shape(image, generator(seed)).shape[1] for seed in range(60)}
    assert 38 <= min(turned) < 50
    assert 130 < max(turned) <= 160
    shrunk = {
        Augmentation(flip=0, log2_shrink=0.5, log2_zoom=0.5).change_shape(image, generator(s)).shape for s in range(60)
    }
    widths = [width for _, width in shrunk]
    assert 40 <= min(widths) < 48
    assert 72 < max(widths) <= 80
    assert all(abs(height / width - 0.75) < 0.02 for height, width in shrunk)
    assert Augmentation(flip=0, rotation=0.5).change_shape(image, generator()).shape != image.shape


def test_the_look_of_a_single_image_changes_with_its_probabilities():
    image = texture(40, 50)
    nothing, light = Augmentation(photometric=0), Augmentation(photometric=1)
    np.testing.assert_array_equal(nothing.change_look(image, generator()), image)
    assert (light.change_look(image, generator()) != image).mean() > 0.5
    negative = Augmentation(photometric=0, invert=0.5)
    looks = [negative.change_look(image, generator(seed)) for seed in range(100)]
    assert 25 < sum(np.array_equal(look, 255 - image) for look in looks) < 75
    assert all(np.array_equal(look, image) or np.array_equal(look, 255 - image) for look in looks)
