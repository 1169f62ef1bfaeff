import time

from textured_scenes import texture
from tiny_network import tiny_network

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.selection import PointSelector
from sips_lit.detect.steps import recorded_steps, step


def test_times_of_equal_names_add_up_and_nothing_is_kept_without_a_record():
    with recorded_steps() as steps:
        for _ in range(2):
            with step("sleep"):
                time.sleep(0.01)
    with step("unheard"):
        pass
    assert list(steps) == ["sleep"]
    assert 20 <= steps["sleep"] < 2000


def test_the_steps_of_a_detection_are_parts_of_it():
    detector = SipsDetector(tiny_network(scales=2), PointSelector())
    with recorded_steps() as steps:
        start = time.perf_counter()
        detector(texture(60, 80, 1))
        whole = 1e3 * (time.perf_counter() - start)
    assert set(steps) == {"network", "suppression", "sub-pixel"}
    assert 0 < min(steps.values()) <= sum(steps.values()) < whole
