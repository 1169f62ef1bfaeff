from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from types import MappingProxyType

import cv2
import numpy as np
import pytest
from textured_scenes import flight, keypoints

from sips_lit.describe.orb import OrbDescriptor
from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.independent import IndependentCheck
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import shrink_images
from sips_lit.train.labelling import images_between, in_frame, label_along, label_pair
from sips_lit.types import Inliers, Keypoints, Reason

PAIR = read_pair(flight(5), 0, 4)


def corners(image: np.ndarray, n: int = 60) -> Keypoints:
    return keypoints(cv2.goodFeaturesToTrack(image, n, 1e-3, 6))


POINTS0, POINTS1 = corners(PAIR.image0), corners(PAIR.image1)


class Dependent(IndependentCheck):
    """A check that needs all matches at once."""

    independent, protocol = False, {"inliers": "all"}

    def __call__(self, pair, keypoints0, keypoints1, matches):
        self.seen = len(matches)
        return HomographyInliers()(pair, keypoints0, keypoints1, matches)


class NextKnown(IndependentCheck):
    """Each match tells about the points after its own, which may have no match; none is an inlier."""

    protocol = MappingProxyType({"inliers": "next"})

    def __call__(self, pair, keypoints0, keypoints1, matches):
        known0, known1 = np.zeros(len(keypoints0), np.bool_), np.zeros(len(keypoints1), np.bool_)
        known0[(matches.index0 + 1) % len(known0)] = True
        known1[(matches.index1 + 1) % len(known1)] = True
        far = np.full(len(matches), Reason.FAR, np.uint8)
        return Inliers(far == Reason.INLIER, far, known0, known1)


class HalfKnown(IndependentCheck):
    """Knows the points whose index is even, and those that an inlier match shows."""

    protocol = MappingProxyType({"inliers": "half"})

    def __call__(self, pair, keypoints0, keypoints1, matches):
        answer = HomographyInliers()(pair, keypoints0, keypoints1, matches)
        known0, known1 = np.arange(len(keypoints0)) % 2 == 0, np.arange(len(keypoints1)) % 2 == 0
        reason = answer.reason.copy()
        reason[~answer.inlier & ~known0[matches.index0]] = Reason.UNKNOWN
        known0[matches.index0[answer.inlier]] = True
        known1[matches.index1[answer.inlier]] = True
        return Inliers(answer.inlier, reason, known0, known1)


def slow_matches(points0: Keypoints, points1: Keypoints) -> list[tuple[int, int]]:
    """Mutual nearest neighbours by Hamming distance, one by one."""
    a, b = (
        np.unpackbits(OrbDescriptor().describe(i, p), axis=1)
        for i, p in ((PAIR.image0, points0), (PAIR.image1, points1))
    )
    d = [[int((x != y).sum()) for y in b] for x in a]
    nearest1 = [min(range(len(b)), key=lambda j, row=row: (row[j], j)) for row in d]
    nearest0 = [min(range(len(a)), key=lambda i, j=j: (d[i][j], i)) for j in range(len(b))]
    return [(i, j) for i, j in enumerate(nearest1) if nearest0[j] == i]


def test_labels_by_hand():
    reason0, reason1 = (np.full(len(p), Reason.UNMATCHED) for p in (POINTS0, POINTS1))
    for i, j in slow_matches(POINTS0, POINTS1):
        in1 = apply_homography(PAIR.homography, POINTS0.xy[[i]])[0]
        in0 = apply_homography(np.linalg.inv(PAIR.homography), POINTS1.xy[[j]])[0]
        near = max(np.linalg.norm(in1 - POINTS1.xy[j]), np.linalg.norm(in0 - POINTS0.xy[i])) <= 3
        visible = (in1 >= -0.5).all() and (in1 <= [159.5, 119.5]).all()
        reason0[i] = reason1[j] = Reason.INLIER if near else Reason.FAR if visible else Reason.LOST
    labels0, labels1, inliers = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), HomographyInliers())
    np.testing.assert_array_equal(labels0.reason, reason0)
    np.testing.assert_array_equal(labels1.reason, reason1)
    for labels in (labels0, labels1):
        np.testing.assert_array_equal(labels.inlier, labels.reason == Reason.INLIER)
        assert labels.known.all()
        assert labels.inlier.sum() > 20
        assert (labels.reason == Reason.UNMATCHED).sum() > 0
    of_inliers = [(i, j) for i, j in slow_matches(POINTS0, POINTS1) if reason0[i] == Reason.INLIER]
    assert sorted(zip(inliers.index0, inliers.index1, strict=True)) == of_inliers


@pytest.mark.parametrize("check", [KltInliers(), HomographyInliers(), HalfKnown(), NextKnown()])
@pytest.mark.parametrize("parts", [2, 3, 500])
def test_parts_side_by_side_change_nothing(check, parts):
    whole = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check)
    with ThreadPoolExecutor(3) as pool:
        split = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check, pool.map, parts)
    for a, b in zip(whole, split, strict=True):
        for key, values in asdict(a).items():
            np.testing.assert_array_equal(values, getattr(b, key))


def test_parts_are_checked_apart():
    sizes = []

    def counting_map(function, *arguments):
        answers = list(map(function, *arguments))
        sizes.append(len(answers))
        return answers

    label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), HomographyInliers(), counting_map, 3)
    assert sizes == [2, 3]  # two images to describe, three parts of the matches


def test_checks_that_need_all_matches_get_them():
    check = Dependent()
    label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check, map, 3)
    assert check.seen == len(slow_matches(POINTS0, POINTS1))


def test_klt_and_the_known_homography_label_alike():
    klt, true = (
        label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check) for check in (KltInliers(), HomographyInliers())
    )
    for a, b in zip(klt[:2], true[:2], strict=True):
        assert (a.inlier == b.inlier).mean() > 0.85
        assert not (a.inlier & ~b.inlier).any()


@pytest.mark.parametrize("empty", [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("parts", [1, 3])
def test_images_without_points(empty, parts):
    points0, points1 = (Keypoints.empty() if e else p for e, p in zip(empty, (POINTS0, POINTS1), strict=True))
    labels0, labels1, inliers = label_pair(PAIR, points0, points1, OrbDescriptor(), KltInliers(), map, parts)
    assert (len(labels0.inlier), len(labels1.inlier)) == (len(points0), len(points1))
    for labels in (labels0, labels1):
        assert (labels.reason == Reason.UNMATCHED).all()
        assert labels.known.all()
        assert not labels.inlier.any()
    assert len(inliers) == 0


@pytest.mark.parametrize("check", [KltInliers(), HomographyInliers()])
def test_points_of_smaller_images_are_judged_where_they_are_in_their_frames(check):
    """Each image has a size of its own; a point of a place keeps its label, whatever it is called in the smaller image."""
    generator = np.random.default_rng(0)
    start = generator.uniform([30, 30], [130, 90], (30, 2))
    goal = apply_homography(PAIR.homography, start) + np.where(np.arange(30) % 2, 6.0, 0.5)[:, None] * [0.6, 0.8]

    class Paired:
        """Describes point i by i: point i matches point i."""

        name, norm = "paired", "l2"

        def describe(self, image, points):
            return np.eye(30, dtype=np.float32)[:, : max(1, len(points))]

    smaller = shrink_images(PAIR, 2, 1.25)  # 80 x 60 and 128 x 96
    points = keypoints((start + 0.5) / 2 - 0.5), keypoints((goal + 0.5) / 1.25 - 0.5)
    labels0, labels1, inliers = label_pair(smaller, *points, Paired(), check)
    even = np.arange(30) % 2 == 0
    assert (labels0.inlier == even).sum() >= 28
    assert (labels1.inlier == labels0.inlier).all()
    assert (inliers.index0 == np.flatnonzero(labels0.inlier)).all()
    if isinstance(check, KltInliers):
        found0, found1 = (labels.residual[labels.inlier] for labels in (labels0, labels1))
        assert np.isnan(labels0.residual[~labels0.inlier]).all()
        np.testing.assert_allclose(np.median(found0, 0), [-0.3 / 1.25, -0.4 / 1.25], atol=0.05)  # pixels of image 1
        np.testing.assert_allclose(np.median(found1, 0), [0.3 / 2, 0.4 / 2], atol=0.05)  # of image 0


def test_keypoints_in_the_frame_of_a_smaller_image():
    points = Keypoints(
        np.array([[0, 0], [79, 29]], np.float32), np.array([1, 1], np.float32), np.array([1, 2], np.float32)
    )
    image, frame = np.zeros((30, 80), np.uint8), np.zeros((60, 160), np.uint8)
    there = in_frame(points, image, frame)
    assert there.xy.tolist() == [[0.5, 0.5], [158.5, 58.5]]  # the outer edges of both images are one
    assert there.scale.tolist() == [2, 4]
    assert in_frame(points, frame, frame) is points


def test_what_is_described_is_what_the_detector_sees():
    """The images may be augmented; the frames that are tracked are not."""
    described = []

    class Noting(OrbDescriptor):
        def describe(self, image, points):
            described.append(image)
            return super().describe(image, points)

    changed = replace(PAIR, image0=255 - PAIR.image0, image1=PAIR.image1 // 2)
    label_pair(changed, POINTS0, POINTS1, Noting(), HomographyInliers())
    assert described[0] is changed.image0
    assert described[1] is changed.image1


def test_labels_at_several_budgets_one_by_one():
    """The points of each budget are matched and judged by themselves; a point counts where it is among them."""
    budgets = (5, 12, 30, 1000)
    count0, count1 = np.zeros(len(POINTS0)), np.zeros(len(POINTS1))
    found = set()
    for n in (*budgets[:3], 500):
        best0, best1 = POINTS0.best(n), POINTS1.best(n)
        labels0, labels1, inliers = label_pair(PAIR, best0, best1, OrbDescriptor(), HomographyInliers())
        count0[: len(best0)] += labels0.inlier
        count1[: len(best1)] += labels1.inlier
        found |= set(zip(inliers.index0.tolist(), inliers.index1.tolist(), strict=True))
    labels0, labels1, inliers = label_pair(
        PAIR, POINTS0, POINTS1, OrbDescriptor(), HomographyInliers(), budgets=budgets
    )
    for labels, count in ((labels0, count0), (labels1, count1)):
        with_it = 1 + sum(np.arange(len(count)) < n for n in budgets[:3])
        np.testing.assert_allclose(labels.share, count / with_it, rtol=1e-6)
        assert 0 < (labels.share % 1 > 0).sum() < len(count)  # both kinds of points
    assert sorted(zip(inliers.index0.tolist(), inliers.index1.tolist(), strict=True)) == sorted(found)
    plain = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), HomographyInliers())[:2]
    for labels, whole in zip((labels0, labels1), plain, strict=True):
        np.testing.assert_array_equal(labels.reason, whole.reason)
        np.testing.assert_array_equal(whole.share, whole.inlier)


def test_matches_that_are_judged_together_have_one_budget():
    check = Dependent()
    labels0, _, inliers = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check, budgets=(5, 12))
    assert check.seen == len(slow_matches(POINTS0, POINTS1))
    np.testing.assert_array_equal(labels0.share, labels0.inlier)
    assert (inliers.last > 10**6).all()


@pytest.mark.parametrize("stops", [(2,), (1, 3)])
def test_labels_of_whole_tracks_are_the_mean_over_pairs_with_the_frames_between(stops):
    """Twin: the pairs as they are read from the sequence, each labelled by itself."""
    sequence, check = flight(5), KltInliers()
    between = {stop: (sequence.frame(stop), corners(sequence.frame(stop), 40)) for stop in stops}
    label = partial(label_pair, descriptor=OrbDescriptor(), check=check)
    labels0, labels1, inliers = label_along(PAIR, POINTS0, POINTS1, between, label)
    whole0, whole1, expected = label_pair(PAIR, POINTS0, POINTS1, OrbDescriptor(), check)
    shares0, shares1 = [whole0.inlier], [whole1.inlier]
    for stop, (_, points) in between.items():
        from_0, to_1 = read_pair(sequence, 0, stop), read_pair(sequence, stop, 4)
        shares0.append(label_pair(from_0, POINTS0, points, OrbDescriptor(), check)[0].inlier)
        shares1.append(label_pair(to_1, points, POINTS1, OrbDescriptor(), check)[1].inlier)
    for labels, shares, whole in ((labels0, shares0, whole0), (labels1, shares1, whole1)):
        np.testing.assert_allclose(labels.share, np.mean(shares, axis=0), rtol=1e-6)
        assert (labels.share % 1 > 0).any()  # some points are inliers in a part of the frames
        np.testing.assert_array_equal(labels.reason, whole.reason)
    np.testing.assert_array_equal(inliers.index0, expected.index0)
    np.testing.assert_array_equal(inliers.index1, expected.index1)


@pytest.mark.parametrize(
    ("frames", "most", "positions"), [(5, 1, [2]), (5, 2, [1, 3]), (5, 9, [1, 2, 3]), (2, 3, []), (5, 0, [])]
)
def test_frames_between_are_spread_and_without_the_ends(frames, most, positions):
    pair = read_pair(flight(5), 0, frames - 1)
    images = images_between(pair, most)
    assert list(images) == positions
    for position, image in images.items():
        np.testing.assert_array_equal(image, pair.frames[position])
    smaller = images_between(shrink_images(pair, 2, 1), most)
    assert all(image.shape == tuple(side // 2 for side in pair.image0.shape) for image in smaller.values())
