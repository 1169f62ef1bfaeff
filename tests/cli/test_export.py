import importlib.util
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import sips_lit.cli.export
from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.export.parity import Difference

EXTRA = all(importlib.util.find_spec(name) for name in ("onnx", "onnxscript", "onnxruntime"))


@pytest.fixture
def mine(checkpoint, tmp_path) -> Path:
    """A checkpoint in a folder of its own."""
    (tmp_path / "run").mkdir()
    return Path(shutil.copy(checkpoint, tmp_path / "run" / "best.safetensors"))


def usage(text: str) -> str:
    """The lines of Python that a command ends with."""
    return text[text.rindex("\n\n") :]


def same_scores(a: Path, b: Path, image: Path) -> None:
    first, second = (SipsDetector.from_checkpoint(path)(image) for path in (a, b))
    np.testing.assert_array_equal(first.xy, second.xy)
    np.testing.assert_array_equal(first.score, second.score)


def test_safetensors(command, mine, frames, tmp_path):
    output = tmp_path / "new" / "weights.safetensors"
    result = command("export", f"checkpoint={mine}", f"output={output}")
    assert result.code == 0, result.err
    same_scores(mine, output, frames / "000.png")
    for path in (output, output.with_suffix(".json")):
        assert f"{path} ({path.stat().st_size / 1000:,.1f} kB)" in result.out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "run"]


def test_what_is_printed_works(command, mine, frames, monkeypatch):
    result = command("export", f"checkpoint={mine}")
    monkeypatch.chdir(frames)
    names: dict[str, object] = {}
    exec(usage(result.out).replace("image.png", "000.png"), names)
    assert len(names["keypoints"]) == 50


def test_beside_a_checkpoint_of_a_run(command, mine, frames, tmp_path):
    network, selector = load_checkpoint(mine)
    content = {
        "state_dict": {f"network.{name}": tensor for name, tensor in network.state_dict().items()},
        "hyper_parameters": {"network": network.config, "selector": {"nms_radius": selector.nms_radius}},
    }
    torch.save(content, tmp_path / "run" / "last.ckpt")
    result = command("export", f"checkpoint={tmp_path}/run/last.ckpt")
    assert result.code == 0, result.err
    assert (tmp_path / "run" / "last.json").is_file()
    same_scores(mine, tmp_path / "run" / "last.safetensors", frames / "000.png")


@pytest.mark.skipif(not EXTRA, reason="needs the extra export")
def test_onnx(command, checkpoint, tmp_path, frames, monkeypatch):
    import onnxruntime  # noqa: F401 - the printed lines need it

    several = tmp_path / "several.safetensors"
    network, _ = load_checkpoint(checkpoint)
    pyramid = ScoreNetwork(3, 4, scales=3)
    pyramid.load_state_dict(network.state_dict())
    export_safetensors(pyramid, PointSelector(), several)
    result = command("export", f"checkpoint={several}", "format=onnx")
    assert result.code == 0, result.err
    path = tmp_path / "several.onnx"
    assert f"{path} ({path.stat().st_size / 1000:,.1f} kB)" in result.out
    assert "ONNX Runtime against the detector: probabilities differ by at most" in result.out
    assert "detects on 3 scales, a factor 1.414 apart" in result.out
    monkeypatch.chdir(frames)
    names: dict[str, object] = {}
    exec(usage(result.out).replace("image.png", "000.png"), names)
    expected = SipsDetector.from_checkpoint(checkpoint).score_map(cv2.imread("000.png", cv2.IMREAD_GRAYSCALE))
    np.testing.assert_allclose(names["probability"], expected, atol=1e-5)


@pytest.fixture
def made(monkeypatch) -> list[tuple[object, ...]]:
    """What would be written: models, formats, paths, types of the values, sizes of the images."""
    calls: list[tuple[object, ...]] = []

    def write(model: object, kind: str, path: Path, *image: object) -> tuple[list[Path], Difference]:
        calls.append((model, kind, path, *image))
        path.write_bytes(b"model")
        return [path], Difference(2e-7, 100, 1)

    monkeypatch.setattr(sips_lit.cli.export, "write_model", write)
    monkeypatch.setattr(sips_lit.cli.export, "require_packages", lambda kind: None)
    return calls


def test_a_model_of_points(command, mine, made):
    arguments = ["format=openvino", "points=true", "k=7", "confidence=0.8", "n_max=90", "threshold=0.1", "nms_radius=3"]
    result = command("export", f"checkpoint={mine}", *arguments, "subpixel=false", "image_type=uint8")
    assert result.code == 0, result.err
    ((model, kind, path, image_type, size),) = made
    assert (kind, path, image_type, size) == ("openvino", mine.with_name("best-points.xml"), "uint8", None)
    assert model.budget == Budget(50, 0.1, 7, 0.8, 90)
    assert (model.selector.nms_radius, model.selector.subpixel) == (3, False)
    assert "OpenVINO against the detector: 99 of 100 points are the same" in result.out
    assert f"compile_model('{path}'" in result.out
    assert "scales" not in result.out


def test_fifty_points_unless_told(command, mine, made):
    assert command("export", f"checkpoint={mine}", "format=onnx", "points=true").code == 0
    assert command("export", f"checkpoint={mine}", "format=torch_export", "points=true", "n=7").code == 0
    assert [(model.budget.n, path.name) for model, _, path, *_ in made] == [
        (50, "best-points.onnx"),
        (7, "best-points.pt2"),
    ]


def test_a_model_for_one_size(command, mine, made):
    assert command("export", f"checkpoint={mine}", "format=onnx", "size=[64,48]").code == 0
    assert made[0][4] == (48, 64)


@pytest.fixture
def halving(mine) -> Path:
    """One whose network scores half of an image, and all of a small one."""
    network, selector = load_checkpoint(mine)
    export_safetensors(network.detecting_by(first_octave=1, whole_below=4000), selector, mine)
    return mine


def test_a_model_for_any_size_scores_half_of_small_images_too_and_says_so(command, halving, made):
    result = command("export", f"checkpoint={halving}", "format=onnx")
    assert result.code == 0, result.err
    assert (
        "images of fewer than 4,000 pixels are scored whole by the detector, and as large ones by a model" in result.out
    )
    assert made[0][0].network.detection.whole_below == 0


@pytest.mark.parametrize("arguments", [["size=[64,48]"], ["first_octave=0"], ["whole_below=0"]])
def test_nothing_is_said_where_both_score_small_images_alike(command, halving, made, arguments):
    result = command("export", f"checkpoint={halving}", "format=onnx", *arguments)
    assert result.code == 0, result.err
    assert "scored whole" not in result.out


@pytest.mark.skipif(not EXTRA, reason="needs the extra export")
@pytest.mark.parametrize(("whole_below", "octaves"), [(64 * 48, 1), (64 * 48 + 1, 2)])
def test_a_model_for_one_size_scores_what_the_detector_does(command, mine, tmp_path, whole_below, octaves):
    import onnxruntime

    output = tmp_path / "a.onnx"
    arguments = ["format=onnx", "size=[64,48]", f"output={output}", "first_octave=1", f"whole_below={whole_below}"]
    assert command("export", f"checkpoint={mine}", *arguments).code == 0
    image = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
    (found,) = onnxruntime.InferenceSession(output).run(None, {"image": image[None, None].astype(np.float32)})
    expected = SipsDetector.from_checkpoint(mine, octaves=octaves, first_octave=2 - octaves).score_map(image)
    np.testing.assert_allclose(found[0, 0], expected, atol=1e-5)


def test_weights_that_detect_as_they_are_told(command, mine, tmp_path):
    told = {"octaves": 3, "first_octave": 1, "corners": 0.5, "fine_corners": 0.25, "whole_below": 4000}
    output = tmp_path / "told.safetensors"
    result = command("export", f"checkpoint={mine}", f"output={output}", *(f"{name}={n}" for name, n in told.items()))
    assert result.code == 0, result.err
    network, selector = load_checkpoint(output)
    assert {name: network.config[name] for name in told} == told
    assert selector == load_checkpoint(mine)[1]


def test_points_of_one_of_several_scales(command, made, tmp_path):
    export_safetensors(ScoreNetwork(3, 4, scales=3), PointSelector(), tmp_path / "several.safetensors")
    arguments = [f"checkpoint={tmp_path}/several.safetensors", "format=onnx", "points=true"]
    assert "detects on 3 scales" in command("export", *arguments).sentence
    assert command("export", *arguments, "scales=1").code == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["format=torchscript"], "format is torchscript: give safetensors, onnx, openvino or torch_export"),
        (
            ["points=true"],
            "points=true needs a program, not weights alone: give format=onnx or openvino or torch_export",
        ),
        (["format=onnx", "n=5", "k=3"], "n, k: how points are chosen is a part of the model with points=true only"),
        (
            ["format=onnx", "subpixel=false"],
            "subpixel: how points are chosen is a part of the model with points=true only",
        ),
        (
            ["format=onnx", "whole_below=9"],
            "whole_below is 9: a model for any size scores all images alike; give the size",
        ),
        (["first_octave=9"], "the first octave is 0"),
        (["format=onnx", "points=true", "n=5", "k=3"], "n is 5 and k is 3: give n for a fixed number of points, or k"),
        (["format=onnx", "points=true", "k=300"], "k is 300 and n_max is 200: n_max points can't hold k inliers"),
        (["format=onnx", "points=true", "k=3", "confidence=1"], "confidence is 1: it is a probability"),
        (["format=onnx", "points=true", "n=0"], "n is 0: an exported model needs at least one point"),
        (["format=onnx", "points=true", "nms_radius=-1"], "nms_radius is -1"),
        (["format=onnx", "image_type=float16"], "image_type is float16: give float32 or uint8"),
        (["format=onnx", "size=640"], "size is 640: give a list in square brackets, [1,2]"),
        (["format=onnx", "size=[640]"], "size is [640]: give width and height of the images"),
        (["format=onnx", "size=[0,640]"], "size is [0, 640]: give width and height"),
        (["size=[640,480]"], "size=[640, 480] needs a program, not weights alone: give format=onnx"),
        (["format=torch_export", "output=a.pt"], "name a file that ends in .pt2"),
        (["format="], "format is : give"),
        (["output=weights.pt"], "output is weights.pt: name a file that ends in .safetensors"),
        (["format=onnx", "output=weights.safetensors"], "ends in .onnx"),
        (["checkpoint=gone.ckpt"], "there is no checkpoint gone.ckpt"),
        (["checkpoint="], "there is no checkpoint"),
        (["checkpoint=/"], "there is no checkpoint"),
    ],
)
def test_values_that_are_refused(command, mine, arguments, reason):
    assert reason in command("export", f"checkpoint={mine}", *arguments).sentence
    assert [path.name for path in mine.parent.iterdir()] == [mine.name]


def test_released_weights_are_exported_here_by_default(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert command("export").code == 0
    weights = load_checkpoint(tmp_path / "sips-tiny.safetensors")[0].state_dict()
    for name, tensor in load_checkpoint("sips-tiny")[0].state_dict().items():
        assert torch.equal(weights[name], tensor)


def test_output_that_cannot_be_written(command, mine, tmp_path):
    (tmp_path / "taken").touch()
    (tmp_path / "folder.safetensors").mkdir()
    below = command("export", f"checkpoint={mine}", f"output={tmp_path}/taken/a.safetensors")
    assert "cannot make the folder" in below.sentence
    folder = command("export", f"checkpoint={mine}", f"output={tmp_path}/folder.safetensors")
    assert "cannot write" in folder.sentence
    assert "wrote" not in folder.out


@pytest.mark.parametrize("kind", ["safetensors", "onnx"])
def test_weights_that_are_not_finite(command, mine, tmp_path, kind):
    network, selector = load_checkpoint(mine)
    with torch.no_grad():
        network.layers[1].weight[0, 0, 0, 0] = torch.inf
    export_safetensors(network, selector, mine)
    result = command("export", f"checkpoint={mine}", f"format={kind}", f"output={tmp_path}/out.{kind}")
    assert "holds weights that are not finite" in result.sentence
    assert not (tmp_path / f"out.{kind}").exists()


def test_a_missing_package_is_named(command, mine, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install 'sips_lit[export]'" in command("export", f"checkpoint={mine}", "format=onnx").sentence
