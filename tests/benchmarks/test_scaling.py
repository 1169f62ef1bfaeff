import runpy

import numpy as np
import pytest
from cli_runs import ROOT
from textured_scenes import flight
from video_files import decoded, write_video


@pytest.fixture(scope="module")
def scaling():
    return runpy.run_path(str(ROOT / "benchmarks" / "scaling.py"))


@pytest.mark.parametrize(
    ("loading", "labelling", "cores", "on_gpu", "expected"),
    [
        (1, 64, 64, 0.001, 1 / 0.02),  # frames
        (8, 1, 64, 0.0, 1 / 0.2),  # labels
        (8, 64, 64, 0.0, 1 / 0.1),  # the network
        (8, 8, 2, 0.0, 2 / 0.32),  # all cores, which the network uses, too
        (8, 64, 2, 0.05, 2 / 0.22),  # all cores, which it does not use
        (8, 64, 64, 0.05, 1 / 0.05),  # the GPU
    ],
)
def test_the_least_of_all_stages(scaling, loading, labelling, cores, on_gpu, expected):
    costs = scaling["Costs"](read=0.02, label=0.2, network=0.1)
    assert costs.pairs_per_second(loading, labelling, cores, on_gpu) == pytest.approx(expected)


def test_frames_straight_from_a_video(scaling, tmp_path):
    path = write_video(tmp_path / "a.avi", flight(9, size=(96, 80)).frames)
    for first in (0, 4):
        read = list(scaling["from_video"](path, first, 3, (96, 80)))
        assert len(read) == 3
        for frame, expected in zip(read, decoded(path)[first:], strict=False):
            assert np.abs(frame.astype(int) - expected).max() <= 4  # two decoders
