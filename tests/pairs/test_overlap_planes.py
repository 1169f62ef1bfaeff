"""Overlap by known homographies of a plane, of views in an order and in none."""

import numpy as np
import pytest
from overlap_rows import rows_of
from overlap_scenes import Unordered, there_and_back, views
from textured_scenes import film, flight

from sips_lit.pairs.overlap import OverlapParameters, measure_overlap


@pytest.mark.parametrize("max_span", [200, 3])
@pytest.mark.parametrize("zoom", [0.97, 1.0, 1.05])
def test_known_homographies_tell_the_overlap(zoom, max_span):
    sequence = flight(12, step=(11, 4), zoom=zoom)
    index = measure_overlap(sequence, OverlapParameters(spacing=10, max_span=max_span))
    for i in range(12):
        # each point of a grid by itself: how many frames further it is seen without a break
        reaches = []
        for x in range(5, 160, 10):
            for y in range(5, 120, 10):
                last = i
                while last + 1 < 12:
                    u, v, w = sequence.homography(i, last + 1) @ [x, y, 1]
                    if not (0 <= u / w <= 159 and 0 <= v / w <= 119):
                        break
                    last += 1
                reaches.append(last - i)
        survivors = [sum(reach >= span for reach in reaches) for span in range(1, 12)]
        expected = [count for count in survivors if count][:max_span]
        assert index.points[i] == len(reaches) == 192
        np.testing.assert_allclose(index.overlap(i) * 192, expected)


def test_tracks_and_known_homographies_tell_about_the_same():
    tracked, known = (measure_overlap(scene(12, step=(6, 2)), OverlapParameters()) for scene in (film, flight))
    np.testing.assert_allclose(tracked.overlap(0)[:8], known.overlap(0)[:8], atol=0.15)


def test_without_an_order_each_pair_is_judged_by_itself_and_sizes_may_differ():
    # a wide view, a small part of it, another part apart from that one, the wide view taller
    sequence = views((0, 0, 160, 120), (10, 10, 40, 40), (100, 60, 60, 40), (0, 0, 160, 200))
    index = measure_overlap(sequence, OverlapParameters(spacing=10))
    assert index.points.tolist() == [16 * 12, 4 * 4, 6 * 4, 16 * 20]
    np.testing.assert_allclose(index.overlap(0) * 192, [16, 24, 192])
    np.testing.assert_allclose(index.overlap(1) * 16, [0, 16])  # nothing in common, then all of it
    np.testing.assert_allclose(index.overlap(2) * 24, [24])
    assert index.reach(0.5).tolist() == [1, 1, 1, 0]
    assert index.partners(0, 0.5).tolist() == [3]
    assert index.partners(0, 0.05).tolist() == [1, 2, 3]
    assert index.partners(1, 0.0).tolist() == [3]
    assert index.partners(3, 0.0).tolist() == []


def test_what_left_the_view_of_a_moving_camera_does_not_come_back():
    """10 x 10 points, 16 px apart; the camera goes 80 px to the right, half of the way back, and all of it."""
    sequence = there_and_back(*[(x, 0, 160, 160) for x in (0, 80, 40, 0)])
    index = measure_overlap(sequence, OverlapParameters())
    assert rows_of(index) == [[50, 50, 50], [70, 50], [70], []]
    assert index.motion_to(0)[:, 0].tolist() == [80, 40, 0]
    # in no order each pair stands for itself
    unordered = measure_overlap(views(*[(x, 0, 160, 160) for x in (0, 80, 40, 0)]), OverlapParameters())
    assert rows_of(unordered) == [[50, 80, 100], [70, 50], [70], []]
    assert unordered.motion.tolist() == [[pixels, 0, 0] for pixels in (80, 40, 0, 40, 80, 40)]


@pytest.mark.parametrize(("shift", "seen"), [(8, 3), (9, 2), (-7, 3), (-8, 2)])
def test_points_are_in_view_up_to_the_centres_of_the_border_pixels(shift, seen):
    """Columns 8, 24 and 40 of 48: the border is reached exactly, or passed by a pixel."""
    for windows in (((0, 0, 48, 16), (shift, 0, 48, 16)), ((0, 0, 16, 48), (0, shift, 16, 48))):
        assert rows_of(measure_overlap(there_and_back(*windows), OverlapParameters())) == [[seen], []]


def test_points_behind_the_camera_are_not_in_view():
    """The horizon of the second view is at x = 16 of the first: of 24 and 40, the map of which is inside, none is seen."""
    H = np.array([[1.0, 0, -200], [0, -1, 0], [-1 / 16, 0, 1]])
    mapped = [(H @ [x, 8, 1])[:2] / (H @ [x, 8, 1])[2] for x in (24, 40)]
    assert all(0 <= x <= 399 and 0 <= y <= 399 for x, y in mapped)
    frames = [np.zeros((16, 48), np.uint8), np.zeros((400, 400), np.uint8)]
    scene = Unordered(frames, "horizon", [np.eye(3), H])
    assert rows_of(measure_overlap(scene, OverlapParameters())) == [[0], []]
