import pytest
from textured_scenes import flight
from tiny_contenders import CONTENDERS, MEASURES

from sips_lit.evaluate.benchmark import run_contenders
from sips_lit.evaluate.benchmark_pairs import BenchmarkPairs
from sips_lit.evaluate.pair_choice import choose_pairs
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers


@pytest.fixture(scope="session")
def benchmark_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("benchmark")


@pytest.fixture(scope="session")
def flights(benchmark_folder):
    sequences = [flight(8, size=(160, 120), name="a"), flight(6, size=(100, 90), seed=2, name="b")]
    return sequences, choose_pairs([Source(sequences)], benchmark_folder / "indexes", pairs=6)


@pytest.fixture(scope="session")
def measured_flights(flights, benchmark_folder):
    sequences, listed = flights
    pairs = BenchmarkPairs([Source(sequences)], listed, HomographyInliers())
    return pairs, run_contenders(CONTENDERS, pairs, MEASURES, benchmark_folder / "features")
