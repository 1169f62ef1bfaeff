from pathlib import Path

import cv2
import numpy as np
import pytest
from exported_models import exported, model_of, textured

from sips_lit.detect.detector import SipsDetector
from sips_lit.export.usage import usage


@pytest.mark.parametrize(
    ("name", "kind", "image_type"),
    [
        ("enough", "onnx", "float32"),
        ("map", "onnx", "uint8"),
        ("enough", "openvino", "float32"),
        ("enough", "torch_export", "float32"),
    ],
)
def test_the_lines_give_the_detectors_points(name, kind, image_type, tmp_path, monkeypatch):
    files, _ = exported(name, kind, image_type)
    for suffix, content in files.items():
        (tmp_path / f"model{suffix}").write_bytes(content)
    cv2.imwrite(str(tmp_path / "image.png"), textured((97, 131)))
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(usage(kind, Path(f"model{next(iter(files))}"), model_of(name).outputs, image_type), names)
    model = model_of(name)
    detector = SipsDetector(model.network, model.selector)
    if name == "map":
        np.testing.assert_allclose(names["probability"], detector.score_map(textured((97, 131))), atol=1e-5)
        return
    points, _ = detector.within(textured((97, 131)), model.budget)
    np.testing.assert_allclose(names["xy"], points.xy, atol=1e-3)
    np.testing.assert_allclose(names["probability"], points.score, atol=1e-5)
    np.testing.assert_allclose(names["covariance"], points.covariance, rtol=1e-3)
