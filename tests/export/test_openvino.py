from importlib.util import find_spec

import numpy as np
import pytest
from exported_models import SIZES, exported, model_of, textured

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.selection import score_map

if find_spec("openvino") is None:  # not by importing it: that is for openvino_package
    pytest.skip("needs the extra export", allow_module_level=True)


def test_the_map_is_that_of_the_detector():
    model, (files, run) = model_of("map"), exported("map", "openvino")
    assert set(files) == {".xml", ".bin"}
    assert files[".xml"].startswith(b"<?xml")
    for size in SIZES:
        (actual,) = run(textured(size)[None, None].astype(np.float32))
        expected = score_map(model.network, textured(size), model.selector.recalibration)
        np.testing.assert_allclose(actual[0, 0], expected, atol=1e-5)


@pytest.mark.parametrize("name", ["enough"])
def test_points_are_those_of_the_detector(name):
    model, run = model_of(name), exported(name, "openvino")[1]
    for size in SIZES:
        outputs = run(textured(size)[None, None].astype(np.float32))
        points, _ = SipsDetector(model.network, model.selector).within(textured(size), model.budget)
        assert int(outputs[2][0]) == len(points)
        np.testing.assert_allclose(outputs[0][0, : len(points)], points.xy, atol=1e-3)
        np.testing.assert_allclose(outputs[1][0, : len(points)], points.score, atol=1e-5)
