import pickle

import cv2
import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.datasets.layered_flight import COVER, LayeredFlight, ragged_cover
from sips_lit.datasets.virtual_flight import flights_over, virtual_flight
from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import sample_depth, transfer
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Keypoints, Matches

SIZE = (160, 120)
STILLS = [(f"still{i}", cv2.GaussianBlur(texture(300, 400, i), (0, 0), 2)) for i in range(3)]


def flights(count: int = 4, seed: int = 0, layers: int = 3, length: int = 40) -> list[LayeredFlight]:
    made = flights_over(STILLS, SIZE, length, count, seed, layers)
    assert all(isinstance(flight, LayeredFlight) for flight in made)
    return made  # type: ignore[return-value]  # asserted above


def grid() -> np.ndarray:
    y, x = np.mgrid[4 : SIZE[1] - 4 : 3, 4 : SIZE[0] - 4 : 3]
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def looked_up(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    return cv2.remap(image, *xy.astype(np.float32).T, cv2.INTER_LINEAR).ravel().astype(np.float64)


def moved_points(flight: LayeredFlight, i: int, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of frame i, where depth and pose put them in frame j, and which of these are in it and not hidden there."""
    xy, T = grid(), np.linalg.inv(flight.pose(j)) @ flight.pose(i)
    moved, distance = transfer(xy, sample_depth(flight.depth(i), xy), flight.camera(i), flight.camera(j), T)
    there = sample_depth(flight.depth(j), moved)
    return xy, moved, np.abs(there - distance) < 1e-3 * distance


def test_pose_and_depth_carry_one_frame_into_another():
    for flight in flights():
        xy, moved, seen = moved_points(flight, 5, 12)
        assert seen.mean() > 0.3
        here, there = looked_up(flight.frame(5), xy[seen]), looked_up(flight.frame(12), moved[seen])
        off = looked_up(flight.frame(12), moved[seen] + 2)
        assert np.median(np.abs(here - there)) <= 2
        assert np.mean(np.abs(here - there)) < 0.6 * np.mean(np.abs(here - off))  # two pixels off would show


def test_depth_is_where_the_ray_meets_the_nearest_cover():
    """Ray by ray, from the definition: planes z = -elevation below a camera that looks along z."""
    generator = np.random.default_rng(0)
    for flight in flights(2):
        index = 7
        pose, depth, unit = flight.pose(index), flight.depth(index), flight._unit
        for x, y in generator.integers(0, SIZE, (40, 2)):
            ray = pose[:3, :3] @ np.linalg.solve(flight.camera(index).matrix, [x, y, 1])
            expected, doubtful = -pose[2, 3] / ray[2], False
            for layer in flight._layers:
                along = (-layer.elevation / unit - pose[2, 3]) / ray[2]
                place = (pose[:2, 3] + along * ray[:2]) * unit * layer.scale + layer.shift
                around = cv2.copyMakeBorder(layer.cover, *[1200] * 4, cv2.BORDER_REFLECT_101)
                column, row = np.round(place).astype(int) + 1200
                patch = around[row - 1 : row + 2, column - 1 : column + 2]
                doubtful |= bool(patch.min() != patch.max())  # at an outline it is a matter of rounding
                if patch[1, 1]:
                    expected = min(expected, along)
            if not doubtful:
                assert depth[y, x] == pytest.approx(expected, rel=1e-4)


def test_things_hide_each_other():
    hidden, edges = [], []
    for flight in flights(6):
        depth = flight.depth(0)
        assert (depth > 0).all()
        edges.append(np.any(np.abs(np.diff(depth, axis=1)) > 0.05 * depth[:, 1:]))
        _, moved, seen = moved_points(flight, 0, 20)
        inside = ((moved > 1) & (moved < np.array(SIZE) - 2)).all(1)
        hidden.append(np.mean(~seen[inside]))
    assert np.mean(edges) > 0.9
    assert 0.02 < np.mean(hidden) < 0.6


def test_labels_are_right_away_from_outlines_and_wrong_for_another_layer():
    (flight, *_) = flights(1)
    pair = read_pair(flight, 5, 10, between=False)
    xy, moved, seen = moved_points(flight, 5, 10)

    def keypoints(at: np.ndarray) -> Keypoints:
        return Keypoints(at.astype(np.float32), np.ones(len(at), np.float32), np.ones(len(at), np.float32))

    one_to_one = Matches(np.arange(seen.sum()), np.arange(seen.sum()))
    right = PoseDepthInliers(threshold=1)(pair, keypoints(xy[seen]), keypoints(moved[seen]), one_to_one)
    wrong = PoseDepthInliers(threshold=1)(pair, keypoints(xy[seen]), keypoints(moved[seen] + 3), one_to_one)
    assert right.inlier.mean() > 0.95
    assert wrong.inlier.mean() == 0


def test_overlap_falls_as_the_flight_goes_on():
    for flight in flights(1):
        overlap = measure_overlap(flight, OverlapParameters()).overlap(0)
        assert overlap[0] > 0.5
        assert overlap[-1] <= overlap[0]


def test_the_same_arguments_give_the_same_flight():
    (first, *_), (again, *_), (other, *_) = flights(1), flights(1), flights(1, seed=1)
    np.testing.assert_array_equal(first.frame(3), again.frame(3))
    assert first.fingerprint == again.fingerprint != other.fingerprint
    assert first.name != flights_over(STILLS, SIZE, 40, 1)[0].name
    copy = pickle.loads(pickle.dumps(first))
    np.testing.assert_array_equal(copy.frame(9), first.frame(9))
    np.testing.assert_array_equal(copy.depth(9), first.depth(9))


@pytest.mark.parametrize("seed", range(8))
def test_covers_are_neither_empty_nor_full(seed: int):
    cover = ragged_cover((240, 320), 60, np.random.default_rng(seed))
    assert set(np.unique(cover)) == {0, 255}
    assert COVER[0] - 0.01 <= (cover > 0).mean() <= COVER[1] + 0.01


def test_one_photograph_is_enough(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), STILLS[0][1])
    (flight,) = virtual_flight(tmp_path / "a.png", SIZE, 5, 1, layers=1)
    assert isinstance(flight, LayeredFlight)
    assert flight.frame(4).shape == SIZE[::-1]


def test_a_negative_number_of_layers_is_refused():
    with pytest.raises(BadInputError, match="layers >= 0"):
        flights_over(STILLS, SIZE, layers=-1)
