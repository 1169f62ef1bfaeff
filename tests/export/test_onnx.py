import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from exported_models import BUDGETS, RECALIBRATED, SIZES, exported, model_of, of_one_size, textured

from sips_lit.detect.checkpoint import METADATA_KEY, config_json
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.peaks import local_maxima
from sips_lit.detect.selection import score_map
from sips_lit.export.parity import difference_of

onnx = pytest.importorskip("onnx", reason="needs the extra export")
pytest.importorskip("onnxruntime", reason="needs the extra export")
pytest.importorskip("onnxscript", reason="needs the extra export")


@pytest.mark.parametrize("size", SIZES)
def test_the_map_is_that_of_the_detector(size):
    model, image = model_of("map"), textured(size)
    (actual,) = exported("map", "onnx")[1](image[None, None].astype(np.float32))
    assert (actual.dtype, actual.shape) == (np.float32, (1, 1, *size))
    expected = score_map(model.network, image, RECALIBRATED.recalibration)
    np.testing.assert_allclose(actual[0, 0], expected, atol=1e-5)
    assert size == (1, 1) or np.ptp(actual) > 1e-4


def test_points_of_the_map_are_those_of_the_detector():
    model, image = model_of("map"), textured((97, 131))
    (probability,) = exported("map", "onnx")[1](image[None, None].astype(np.float32))
    rows, columns = local_maxima(torch.from_numpy(probability[0, 0]), RECALIBRATED.nms_radius)
    inner = (np.minimum(rows, 96 - rows) >= 3) & (np.minimum(columns, 130 - columns) >= 3)  # its border
    rows, columns = rows[inner], columns[inner]
    points = RECALIBRATED.select(model.network, torch.from_numpy(image)[None, None].float(), 25)
    np.testing.assert_array_equal(np.stack([rows[:25], columns[:25]]), np.stack([points.row, points.column]))


@pytest.mark.parametrize("name", ["enough"])
@pytest.mark.parametrize("size", SIZES)
def test_points_are_those_of_the_detector(name, size):
    """The same pixels in the same order; positions and probabilities up to the runtime's rounding."""
    model, image = model_of(name), textured(size)
    outputs = exported(name, "onnx")[1](image[None, None].astype(np.float32))
    points, enough = SipsDetector(model.network, model.selector).within(image, model.budget)
    assert int(outputs[2][0]) == len(points)
    np.testing.assert_allclose(outputs[0][0, : len(points)], points.xy, atol=1e-3)
    np.testing.assert_allclose(outputs[1][0, : len(points)], points.score, atol=1e-5)
    assert bool(outputs[3][0]) == enough


def test_covariances_are_those_of_the_detector():
    model, image = model_of("enough"), textured((97, 131))
    outputs = exported("enough", "onnx")[1](image[None, None].astype(np.float32))
    points = SipsDetector(model.network, model.selector).within(image, model.budget)[0]
    assert len(model.outputs) == len(outputs) == 5
    np.testing.assert_allclose(outputs[4][0, : len(points)], points.covariance, rtol=1e-3)
    assert np.ptp(points.covariance[:, 0, 0]) > 0.01


@pytest.mark.parametrize("name", ["map", "enough"])
def test_a_batch_is_its_images(name):
    run = exported(name, "onnx")[1]
    images = np.stack([textured((33, 47), seed) for seed in (1, 2, 3)])[:, None].astype(np.float32)
    together = run(images)
    for index in range(3):
        for many, one in zip(together, run(images[index : index + 1]), strict=True):
            np.testing.assert_allclose(many[index : index + 1], one, atol=1e-4)
    assert np.abs(together[0][0] - together[0][1]).max() > 1e-3


def test_a_model_for_one_size_gives_the_same_and_takes_no_other():
    """Without an operation that asks for the size, which old readers lack."""
    files, run = of_one_size("map", (97, 131))
    image = textured((97, 131))[None, None].astype(np.float32)
    np.testing.assert_allclose(run(image)[0], exported("map", "onnx")[1](image)[0], atol=1e-6)
    assert difference_of(model_of("map"), run, size=(97, 131)).is_small
    assert "Shape" not in {node.op_type for node in onnx.load_from_string(files[".onnx"]).graph.node}
    with pytest.raises(Exception, match=r"(?i)dimension"):
        run(image[..., :-1])


def test_more_points_than_there_are():
    outputs = exported("enough", "onnx")[1](textured((20, 24))[None, None].astype(np.float32))
    xy, score, count = (output[0] for output in outputs[:3])
    assert 0 < count < BUDGETS["enough"].n_max == len(xy)
    assert score[:count].min() > 0 == score[count:].max()
    assert (xy[count:] == -1).all()


def test_a_blank_image():
    count = exported("enough", "onnx")[1](np.full((1, 1, 60, 80), 90, np.float32))[2]
    assert count <= 4, "rounding at the borders of a runtime's blocks may leave some"


def test_bytes_are_taken_where_asked():
    (probability,) = exported("map", "onnx", "uint8")[1](textured((33, 47))[None, None])
    (expected,) = exported("map", "onnx")[1](textured((33, 47))[None, None].astype(np.float32))
    np.testing.assert_allclose(probability, expected, atol=1e-6)


@pytest.mark.parametrize("name", ["map", "enough"])
def test_the_model_tells_what_it_is(name):
    content, model = exported(name, "onnx")[0][".onnx"], model_of(name)
    stored = onnx.load_from_string(content)
    properties = {entry.key: entry.value for entry in stored.metadata_props}
    assert json.loads(properties[METADATA_KEY]) == json.loads(config_json(model.network, model.selector))
    assert json.loads(properties[METADATA_KEY])["recalibration"] == RECALIBRATED.recalibration.config
    assert properties["sips_lit_version"]
    assert "0 to 255" in stored.doc_string
    (given,) = stored.graph.input
    assert [made.name for made in stored.graph.output] == list(model.outputs)
    shape = given.type.tensor_type.shape.dim
    assert [bool(dim.dim_param) for dim in shape] == [True, False, True, True]
    for trace in (b".py", b"sips_lit/", str(Path(__file__).parents[2]).encode()):
        assert trace not in content, "nothing of this machine"


def test_opencv_runs_the_map():
    """OpenCV 4 can't pad an image by more pixels than it has: sizes below the network's radius are for OpenCV 5."""
    content, run = exported("map", "onnx")
    network = cv2.dnn.readNetFromONNX(np.frombuffer(content[".onnx"], np.uint8))
    sizes = [size for size in SIZES if min(size) > 4 or cv2.__version__ >= "5"]
    for image in [textured(size)[None, None] for size in sizes] + [
        np.stack([textured((33, 47), s)[None] for s in (1, 2)])
    ]:
        network.setInput(image.astype(np.float32))
        np.testing.assert_allclose(network.forward(), run(image.astype(np.float32))[0], atol=1e-5)
