import numpy as np
import pytest

from sips_lit.pairs.motion import as_complex, motion_of


def random_points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform((0, 0), (640, 480), (count, 2))


@pytest.mark.parametrize("count", [2, 3, 50, 51])
@pytest.mark.parametrize("seed", range(3))
def test_as_median_and_least_squares(count, seed):
    xy0, xy1 = random_points(count, seed), random_points(count, seed + 9)
    ((moved, turn, zoom),) = motion_of(as_complex(xy0)[None], as_complex(xy1), np.array([count]))
    assert moved == pytest.approx(np.sort(np.linalg.norm(xy1 - xy0, axis=1))[(count - 1) // 2], rel=1e-3)
    (x, y), one, zero = xy0.T, np.ones(count), np.zeros(count)
    equations = np.concatenate([np.stack([x, -y, one, zero], 1), np.stack([y, x, zero, one], 1)])
    a, b, *_ = np.linalg.lstsq(equations, xy1.T.ravel(), rcond=None)[0]
    assert turn == pytest.approx(np.degrees(np.arctan2(b, a)), abs=0.1)
    assert zoom == pytest.approx(np.log2(np.hypot(a, b)), abs=0.01)


@pytest.mark.parametrize(("degrees", "factor", "shift"), [(0, 1, (3, 4)), (30, 2, (0, 0)), (-100, 0.5, (50, -7))])
def test_a_similarity_is_found(degrees, factor, shift):
    xy0, angle = random_points(40), np.radians(degrees)
    turned = factor * xy0 @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) + shift
    ((moved, turn, zoom),) = motion_of(as_complex(xy0)[None], as_complex(turned), np.array([40]))
    assert turn == pytest.approx(degrees, abs=0.1)
    assert zoom == pytest.approx(np.log2(factor), abs=0.01)
    if degrees == 0:
        assert moved == 5


def test_rows_are_apart_and_what_is_beyond_the_counts_does_not_matter():
    xy1, counts = as_complex(random_points(9)), np.array([9, 4, 1, 0])
    xy0 = np.stack([as_complex(random_points(9, seed)) for seed in range(1, 5)])
    together = motion_of(xy0, xy1, counts)
    for row, count in enumerate(counts):
        xy0[row, count:] = np.nan
        alone = motion_of(xy0[row : row + 1, :count], xy1[:count], counts[row : row + 1])
        np.testing.assert_array_equal(together[row : row + 1], alone)
    np.testing.assert_array_equal(motion_of(xy0, xy1, counts), together)
    np.testing.assert_array_equal(together[3], [0, 0, 0])
    np.testing.assert_array_equal(together[2, 1:], [0, 0])  # one point tells of no turn
