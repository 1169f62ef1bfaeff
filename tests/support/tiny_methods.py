"""Small methods, and what is measured of them."""

import torch

from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.evaluate.measure import Measures
from sips_lit.evaluate.method import Method

MEASURES = Measures(ks=(5, 8), n_max=60, budgets=(20,), calibration=(20, 90), iterations=100)


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
