import time

import numpy as np
from textured_scenes import texture
from tiny_network import tiny_detector

from sips_lit.baselines.orb import OrbDetector
from sips_lit.describe.sift import RootSift
from sips_lit.detect.base import BaseDetector
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.speed import measure_speed, synthetic_image
from sips_lit.types import Keypoints

IMAGES = [texture(60, 80, seed) for seed in (1, 2)]


class Sleeper(BaseDetector):
    """Notes when it is called, and takes so many seconds, the first time longer."""

    def __init__(self, name: str, seconds: float, calls: list[str]) -> None:
        self.name, self.seconds, self.calls = name, seconds, calls

    def detect(self, image: np.ndarray, n: int) -> Keypoints:
        time.sleep(self.seconds * (1 if self.name in self.calls else 20))
        self.calls.append(self.name)
        points = np.full((n, 2), 20, np.float32)
        return Keypoints(points, np.ones(n, np.float32), np.ones(n, np.float32))


def test_methods_take_turns_and_the_first_round_does_not_count():
    calls: list[str] = []
    methods = [
        Method(name, name.upper(), Sleeper(name, seconds, calls), RootSift(), {})
        for name, seconds in (("a", 0.01), ("b", 0.001))
    ]
    slow, fast = measure_speed(methods, IMAGES, 3, 4)
    assert calls == ["a", "a", "b", "b"] * 5
    assert (slow.name, slow.found) == ("A", 3)
    assert [len(times) for times in slow.milliseconds.values()] == [4, 4, 4]
    assert 10 <= slow.least("points") <= slow.median("points") < 100  # an image, not a round; not the 200 ms at first
    assert 1 <= fast.least("points") < slow.least("points")


def test_what_each_kind_of_method_tells():
    own = Method("orb", "ORB", OrbDetector(), None, {})
    ours = Method("sips", "SIPs", tiny_detector(), RootSift(), {})
    orb, sips = measure_speed([own, ours], IMAGES[:1], 20, 2)
    assert list(orb.milliseconds) == ["points", "match"]
    assert orb.median("network") is None is orb.least("describe")
    assert list(sips.milliseconds) == ["points", "network", "suppression", "sub-pixel", "top n", "describe", "match"]
    parts = [sips.milliseconds[name] for name in ("network", "suppression", "sub-pixel", "top n")]
    np.testing.assert_allclose(np.sum(parts, 0), sips.milliseconds["points"])
    assert min(map(min, parts)) > 0


def test_the_image_that_is_made_up_has_structure():
    image = synthetic_image((64, 48))
    assert (image.shape, image.dtype) == ((48, 64), np.uint8)
    assert image.std() > 20
    np.testing.assert_array_equal(image, synthetic_image((64, 48)))
