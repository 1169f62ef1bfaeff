import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from textured_scenes import texture

from sips_lit.detect.checkpoint import METADATA_KEY, config_json
from sips_lit.detect.peaks import local_maxima
from sips_lit.detect.recalibration import Recalibration
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor, score_map
from sips_lit.errors import BadInputError
from sips_lit.export.onnx import export_onnx, max_difference, require_export_extra

onnx = pytest.importorskip("onnx", reason="needs the extra export")
onnxruntime = pytest.importorskip("onnxruntime", reason="needs the extra export")
pytest.importorskip("onnxscript", reason="needs the extra export")

SELECTOR = PointSelector(4, subpixel=False)


def make_network(seed: int = 0, derivatives: bool = False) -> ScoreNetwork:
    torch.manual_seed(seed)
    return ScoreNetwork(3, 4, derivatives=derivatives).eval()


@pytest.fixture(scope="module", params=[False, True], ids=["grey", "derivatives"])
def network(request) -> ScoreNetwork:
    return make_network(derivatives=request.param)


@pytest.fixture(scope="module")
def exported(network, tmp_path_factory) -> tuple[Path, float]:
    """The model as a file, and the difference that was measured: exporting is slow."""
    path = tmp_path_factory.mktemp("onnx") / "tiny.onnx"
    return path, export_onnx(network, SELECTOR, path)


@pytest.fixture(scope="module")
def session(exported):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(exported[0], options, providers=["CPUExecutionProvider"])


def probability(session, images: np.ndarray) -> np.ndarray:
    return session.run(None, {"image": images.astype(np.float32)})[0]


# usual, odd, a line, smaller than the receptive field, and a single pixel
@pytest.mark.parametrize("size", [(120, 160), (97, 131), (1, 40), (5, 3), (1, 1)])
def test_scores_are_those_of_the_network(network, session, size):
    image = texture(120, 160, 3)[: size[0], : size[1]]
    with torch.no_grad():
        expected = torch.sigmoid(network(image_tensor(image))).numpy()
    actual = probability(session, image[None, None])
    assert actual.dtype == np.float32
    assert actual.shape == (1, 1, *size)
    np.testing.assert_allclose(actual, expected, atol=1e-5)


def test_a_batch_is_its_images(session):
    images = np.stack([texture(33, 47, seed)[None] for seed in (1, 2)])
    both = probability(session, images)
    assert both.shape == (2, 1, 33, 47)
    for index in range(2):
        np.testing.assert_allclose(both[index : index + 1], probability(session, images[index : index + 1]), atol=1e-6)
    assert np.abs(both[0] - both[1]).max() > 1e-3


@pytest.mark.parametrize("size", [(120, 160), (97, 131), (5, 3)])
def test_the_points_are_those_of_the_detector(network, session, size):
    image = texture(120, 160, 4)[: size[0], : size[1]]
    rows, columns = local_maxima(torch.from_numpy(probability(session, image[None, None])[0, 0]), SELECTOR.nms_radius)
    points = SELECTOR.select(network, image_tensor(image), 25)
    np.testing.assert_array_equal(rows[:25], points.row)
    np.testing.assert_array_equal(columns[:25], points.column)
    np.testing.assert_array_equal(points.keypoints.xy, np.stack([columns, rows], 1)[:25])


def test_the_measured_difference_is_small_and_true(network, exported):
    path, difference = exported
    assert 0 <= difference < 1e-5
    assert max_difference(network, path.read_bytes(), [(1, 1, 20, 30)]) < 1e-5
    assert max_difference(make_network(seed=1), path.read_bytes(), [(1, 1, 20, 30)]) > 1e-3


def test_the_model_tells_what_it_is(network, exported):
    model = onnx.load(exported[0])
    properties = {entry.key: entry.value for entry in model.metadata_props}
    assert json.loads(properties[METADATA_KEY]) == json.loads(config_json(network, SELECTOR))
    assert properties["sips_lit_version"]
    assert "0 to 255" in model.doc_string
    (given,), (made,) = model.graph.input, model.graph.output
    assert (given.name, made.name) == ("image", "probability")
    for value in (given, made):
        shape = value.type.tensor_type.shape.dim
        assert [bool(dim.dim_param) for dim in shape] == [True, False, True, True]
        assert shape[1].dim_value == 1


def test_nothing_of_this_machine_is_in_the_model(exported):
    content = exported[0].read_bytes()
    for trace in (b".py", b"sips_lit/", str(Path(__file__).parents[2]).encode()):
        assert trace not in content


def test_nothing_is_written_when_the_two_disagree(network, tmp_path, monkeypatch):
    monkeypatch.setattr("sips_lit.export.onnx.onnx_model", lambda *_: b"")
    for difference in (2e-4, float("nan")):
        monkeypatch.setattr("sips_lit.export.onnx.max_difference", lambda *_, d=difference: d)
        with pytest.raises(RuntimeError, match="nothing was written"):
            export_onnx(network, SELECTOR, tmp_path / "a.onnx")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written(network, tmp_path, monkeypatch):
    monkeypatch.setattr("sips_lit.export.onnx.onnx_model", lambda *_: b"")
    monkeypatch.setattr("sips_lit.export.onnx.max_difference", lambda *_: 0.0)
    with pytest.raises(BadInputError, match=r"cannot write .*a\.onnx"):
        export_onnx(network, SELECTOR, tmp_path / "gone" / "a.onnx")


def test_missing_packages_are_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "onnxscript" else name)
    with pytest.raises(BadInputError, match=r"needs onnxscript: install them with pip install 'sips_lit\[export\]'"):
        require_export_extra()


def test_a_recalibration_is_in_the_map_and_in_the_metadata(tmp_path):
    network, recalibration = make_network(), Recalibration(0.6, 0.8, 0.3, 1.1)
    path = tmp_path / "calibrated.onnx"
    assert export_onnx(network, replace(SELECTOR, recalibration=recalibration), path) < 1e-5
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert json.loads(properties[METADATA_KEY])["recalibration"] == recalibration.config
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    image = texture(33, 47)
    np.testing.assert_allclose(
        probability(session, image[None, None])[0, 0], score_map(network, image, recalibration), atol=1e-5
    )
