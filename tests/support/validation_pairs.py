"""Validation without a trainer: pairs whose matches are known, and what callbacks ask of a module and a trainer."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from textured_scenes import flight, keypoints

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.verification import VerifiedPair, verify
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Features

N = 30
TRAINER = SimpleNamespace(global_step=12, is_global_zero=True, loggers=[])


class Module:
    """What the callbacks ask of a module; keeps what is logged."""

    device = torch.device("cpu")

    def __init__(self) -> None:
        torch.manual_seed(0)
        self.network, self.logged = ScoreNetwork(3, 4), {}

    def log(self, name: str, value: Any, **_: Any) -> None:
        self.logged[name] = float(value)

    def log_dict(self, values: Any, **_: Any) -> None:
        self.logged |= {name: float(value) for name, value in values.items()}


def verified(good: int, n: int = N, seed: int = 0, scale: float = 1.0) -> VerifiedPair:
    """A pair whose first ``good`` points correspond and match, and whose other matches are wrong."""
    pair = read_pair(flight(4, size=(120, 90), seed=seed), 0, 3)
    assert pair.homography is not None
    generator = np.random.default_rng(seed)
    xy0 = generator.uniform([30, 30], [90, 60], (n, 2))
    xy1 = apply_homography(pair.homography, xy0)
    xy1[good:] += 25
    descriptors = np.eye(max(n, 1), dtype=np.float32)[:n] * 9
    score = np.linspace(0.9, 0.1, n) * scale
    features = [Features(keypoints(xy, score), descriptors, "l2") for xy in (xy0, xy1)]
    return verify(pair, *features, HomographyInliers())


def validate(callback: Any, *pairs: VerifiedPair) -> Module:
    """Runs a validation as the trainer does."""
    module = Module()
    if hasattr(callback, "metric"):
        callback.on_validation_start(TRAINER, module)
    for index, pair in enumerate(pairs):
        callback.on_validation_batch_end(TRAINER, module, pair, None, index)
    if hasattr(callback, "metric"):
        callback.on_validation_epoch_end(TRAINER, module)
    return module
