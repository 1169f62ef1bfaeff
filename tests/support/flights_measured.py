"""Fixtures: two flights, and what is measured of the tiny methods on them."""

import pytest
from textured_scenes import flight
from tiny_methods import MEASURES, METHODS, run_methods

from sips_lit.evaluate.pair_set import PairSet
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.pairs.choice import choose_pairs


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
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    return pairs, run_methods(METHODS, pairs, MEASURES, benchmark_folder / "features")
