import runpy
from pathlib import Path

from textured_scenes import film

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.step_times import Stopwatch

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "label_time.py"))
Compared = SCRIPT["Compared"]


def test_both_ways_of_labelling_are_counted_and_agree():
    found = Compared(Stopwatch(), Stopwatch())
    pair = read_pair(film(4), 0, 3)
    found.add(pair, ShiTomasi().detect(pair.image0, 100), ShiTomasi().detect(pair.image1, 90))
    assert (found.pairs, found.frames, found.points) == (1, 4, 190)
    assert 0 < found.inliers <= found.matches <= 180
    assert found.agreement >= 0.98
    assert all(set(stages) == {"describe", "match", "track"} for stages in found.milliseconds())
