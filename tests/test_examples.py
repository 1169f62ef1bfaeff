"""The examples run with what the exports give, as their first lines say."""

import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from exported_models import exported, model_of, of_one_size, textured

from sips_lit.detect.detector import SipsDetector

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def image(tmp_path, monkeypatch) -> np.ndarray:
    """In image.png, in the folder where the test runs."""
    monkeypatch.chdir(tmp_path)
    picture = textured((97, 131))
    cv2.imwrite("image.png", picture)
    return picture


def test_points_in_python(image):
    Path("model.onnx").write_bytes(exported("enough", "onnx")[0][".onnx"])
    command = [sys.executable, str(EXAMPLES / "detect_points.py"), "model.onnx"]
    subprocess.run([*command, "image.png", "points.csv"], check=True)
    model = model_of("enough")
    points, _ = SipsDetector(model.network, model.selector).within(image, model.budget)
    found = np.loadtxt("points.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(found, np.column_stack([points.xy, points.score]), atol=1e-3)
    missing = subprocess.run([*command, "gone.png", "other.csv"], capture_output=True, text=True, check=False)
    assert (missing.returncode, "gone.png is no image" in missing.stderr) == (1, True)
    for name in ("torch", "sips_lit"):
        assert f"import {name}" not in (EXAMPLES / "detect_points.py").read_text()


def test_the_map_in_cpp(image):
    found = subprocess.run(["pkg-config", "--cflags", "--libs", "opencv4"], capture_output=True, text=True, check=False)
    if not shutil.which("g++") or found.returncode:
        pytest.skip("needs g++ and OpenCV's headers: apt-get install g++ pkg-config libopencv-dev")
    subprocess.run(["g++", str(EXAMPLES / "probability_map.cpp"), "-o", "map", *found.stdout.split()], check=True)
    Path("model.onnx").write_bytes(of_one_size("map", image.shape)[0][".onnx"])  # distributions have old OpenCV
    subprocess.run(["./map", "model.onnx", "image.png", "map.png"], check=True)
    model = model_of("map")
    expected = 255 * SipsDetector(model.network, model.selector).score_map(image)
    np.testing.assert_allclose(cv2.imread("map.png", cv2.IMREAD_GRAYSCALE), expected, atol=0.6)
