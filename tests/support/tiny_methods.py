"""Small methods, and what is measured of them."""

import torch

from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.result import MethodResult
from sips_lit.evaluate.runner import evaluate_pair_set

MEASURES = Measures(k=8, ks=(5,), n_max=60, n=20, calibration=(20, 90), iterations=100)


def sips() -> SipsDetector:
    torch.manual_seed(0)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


def method(detector, descriptor=None, key="it") -> Method:
    return Method(key, key.title(), detector, descriptor, {"key": key})


METHODS = [
    method(sips(), RootSift(), "sips"),
    method(ShiTomasi(), RootSift(), "corners"),
    method(OrbDetector(), None, "orb"),
    method(SiftDetector(), None, "sift"),
]


def run_methods(methods, pairs, measures, folder=None, **options) -> list[MethodResult]:
    """What `evaluate_pair_set` measures, a record per method."""
    return list(evaluate_pair_set(methods, pairs, measures, folder, **options).detectors)
