import numpy as np
import pytest

from sips_lit.baselines.fast import Fast

CIRCLE = [
    (0, -3), (1, -3), (2, -2), (3, -1), (3, 0), (3, 1), (2, 2), (1, 3),
    (0, 3), (-1, 3), (-2, 2), (-3, 1), (-3, 0), (-3, -1), (-2, -2), (-1, -3),
]  # fmt: skip


def score(image: np.ndarray, x: int, y: int) -> int:
    """Slow twin: the largest threshold t at which 9 neighbours in a row are all brighter, or darker, by more than t."""
    difference = [int(image[y + dy, x + dx]) - int(image[y, x]) for dx, dy in CIRCLE]
    arcs = [[difference[(start + i) % 16] for i in range(9)] for start in range(16)]
    return max(max(min(arc), min(-d for d in arc)) for arc in arcs) - 1


def slow_fast(image: np.ndarray, threshold: int) -> list[tuple[int, int, int]]:
    """(-score, y, x) of the corners that no neighbour in 3 x 3 equals, best first."""
    height, width = image.shape
    scores = np.zeros(image.shape, int)
    for y in range(3, height - 3):
        for x in range(3, width - 3):
            s = score(image, x, y)
            scores[y, x] = s if s >= threshold else 0
    padded = np.pad(scores, 1)
    corners = []
    for y, x in np.argwhere(scores > 0):
        around = padded[y : y + 3, x : x + 3].copy()
        around[1, 1] = 0
        if scores[y, x] > around.max():
            corners.append((-scores[y, x], y, x))
    return sorted(corners)


@pytest.mark.parametrize("threshold", [5, 30])
def test_corners_and_scores_by_definition(threshold):
    image = np.random.default_rng(3).integers(0, 255, (40, 60)).astype(np.uint8)
    image[10:20, 20:40] = 230  # a plateau: corners of a box, and ties
    expected = slow_fast(image, threshold)
    assert len(expected) > 20
    found = Fast(threshold).detect(image, 10_000)
    np.testing.assert_array_equal(found.xy, [(x, y) for _, y, x in expected])
    np.testing.assert_array_equal(found.score, [-s for s, *_ in expected])
    np.testing.assert_array_equal(found.scale, np.ones(len(expected)))
    np.testing.assert_array_equal(Fast(threshold).detect(image, 7).xy, found.xy[:7])


def test_the_score_is_the_largest_threshold():
    image = np.full((50, 60), 50, np.uint8)
    image[20, 33] = 200
    keypoints = Fast().detect(image, 10)
    np.testing.assert_array_equal(keypoints.xy, [[33, 20]])
    np.testing.assert_array_equal(keypoints.score, [149])  # 150 grey levels above the circle around it
    assert len(Fast(threshold=149).detect(image, 10)) == 1
    assert len(Fast(threshold=150).detect(image, 10)) == 0


@pytest.mark.parametrize(("contrast", "count"), [(5, 0), (6, 1)])
def test_the_default_threshold_finds_corners_of_dull_images(contrast, count):
    image = np.full((20, 20), 100, np.uint8)
    image[10, 10] += contrast
    assert len(Fast().detect(image, 10)) == count
