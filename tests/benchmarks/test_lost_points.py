import runpy
from pathlib import Path

import numpy as np
import pytest
from textured_scenes import film

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "lost_points.py"))
fates, partners_of, rows_of = SCRIPT["fates"], SCRIPT["partners_of"], SCRIPT["rows_of"]


def test_shares_by_hand():
    """Of four points: one matched, one matched elsewhere, one found beyond the n best only, one lost."""
    ends = np.array([[10.0, 10], [20, 20], [30, 30], [40, 40], [50, 50]], np.float32)
    followed = np.array([True, True, True, False, True])
    later = np.array([[10.0, 13], [20, 20], [99, 99], [40, 40], [30, 30], [50, 50]], np.float32)
    partners = np.array([0, 2, -1, 3])
    assert fates(ends, followed, later, 4, partners) == (3 / 4, 3 / 4, 2 / 4, 1 / 4)
    later[0, 1] = 13.01  # more than three pixels away
    assert fates(ends, followed, later, 4, partners) == (3 / 4, 2 / 4, 1 / 4, 0)


def test_an_image_and_itself():
    image = film(1).frame(0)
    points = ShiTomasi().detect(image, 30)
    np.testing.assert_array_equal(partners_of((image, image), (points, points), RootSift()), np.arange(len(points)))


def test_a_slow_film_loses_little_and_a_cut_everything():
    (row,) = rows_of("corners", ShiTomasi(), film(4), 2, 1, [20])
    assert row[:2] == ["corners", 20]
    followed, seen, found, inliers = row[2:]
    assert 0.5 < inliers <= found <= seen <= followed <= 1
    cut = film(4)
    cut.frames[2:] = [255 - frame[::-1, ::-1] for frame in cut.frames[2:]]
    assert rows_of("corners", ShiTomasi(), cut, 2, 4, [20])[0][5] == pytest.approx(0, abs=0.1)
