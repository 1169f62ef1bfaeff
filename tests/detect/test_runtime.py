import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from textured_scenes import texture
from tiny_network import tiny_network

from sips_lit.detect import runtime
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.runtime import Fastest, OnnxRuntime, TorchRuntime, installed_runtimes, make_runtime
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor
from sips_lit.errors import BadInputError, InputWarning

IMAGE = image_tensor(texture(77, 101, 3))


@pytest.fixture(autouse=True)
def _nothing_measured(monkeypatch):
    monkeypatch.setattr(runtime, "_FASTEST", {})


@pytest.mark.parametrize(
    "options",
    [
        {"width": 8, "derivatives": True, "octaves": 2, "corners": 0.5},
        {"width": 10, "octaves": 2, "first_octave": 0.5, "octave_step": 0.5},
        {"width": 8, "derivatives": True, "first_octave": 1, "corners": 0.5, "fine_corners": 0.25},
        {"width": 8, "first_octave": 1, "fine_corners": 0.25, "whole_below": 1000},
        {"width": 10},
    ],
)
def test_all_runtimes_give_the_logits_of_the_network(options):
    torch.manual_seed(0)
    network = ScoreNetwork(5, **options).eval()
    runtimes = installed_runtimes(network)
    assert {"torch", "onnxruntime"} <= {each.name for each in runtimes}
    for image in (IMAGE, IMAGE[..., :12, :9].repeat(2, 1, 1, 1), IMAGE[..., :1, :1]):
        with torch.no_grad():
            expected = network(image)
        for each in runtimes:
            torch.testing.assert_close(each(image), expected, rtol=0, atol=1e-5, msg=each.name)
            assert each(image).is_contiguous()


@pytest.mark.parametrize("name", ["onnxruntime", "openvino", "auto"])
def test_the_detector_finds_the_same_points_by_any_runtime(name):
    network, image = tiny_network(scales=3), texture(77, 101, 3)
    expected, found = (SipsDetector(network, PointSelector(), runtime=each)(image, 20) for each in ("torch", name))
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-2)
    np.testing.assert_allclose(found.score, expected.score, atol=1e-5)


@pytest.mark.parametrize("name", ["onnxruntime", "openvino"])
@pytest.mark.parametrize("image", [IMAGE, IMAGE[..., :64, :96]], ids=["cut from blocks", "of whole blocks"])
def test_results_stay_when_the_runtime_goes_on(name, image):
    each = make_runtime(tiny_network(), name)
    first = each(image)
    before = first.clone()
    each(255 - image)
    assert torch.equal(first, before)


@pytest.mark.parametrize("name", ["torch", "onnxruntime", "openvino", "auto"])
def test_threads_share_a_runtime(name):
    """A request of OpenVINO has one memory: a thread got what another's image gave, or an error."""
    each = make_runtime(tiny_network(), name)
    images = [(image + turn) % 256 for turn in range(20) for image in (IMAGE, IMAGE[..., :40, :60])]
    expected = [each(image) for image in images]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(each, images))
    assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))


def test_a_size_of_images_that_was_forgotten_is_compiled_again(monkeypatch):
    monkeypatch.setattr(runtime, "SIZES_KEPT", 1)
    each = make_runtime(tiny_network(), "openvino")
    first = each(IMAGE)
    each(IMAGE[..., :9, :9])
    assert torch.equal(each(IMAGE), first)


@pytest.mark.parametrize(("able", "told"), [(["FP32", "BF16"], 0), (["FP32"], 1)])
def test_bfloat16_that_the_processor_does_not_have_is_told(monkeypatch, able, told):
    core = SimpleNamespace(get_property=lambda device, name: able)
    monkeypatch.setattr("sips_lit.detect.runtime.openvino_core", lambda needed_by: core)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        make_runtime(tiny_network(), "openvino", "bf16")
        make_runtime(tiny_network(), "openvino")
    assert [str(warning.message) for warning in caught] == told * [
        "this processor has no instructions for bfloat16: OpenVINO computes in float32"
    ]


@pytest.mark.parametrize("name", ["torch", "openvino"])
def test_bfloat16_is_near(name):
    torch.manual_seed(0)
    network = ScoreNetwork(5, 8, derivatives=True).eval()
    with torch.no_grad():
        difference = (make_runtime(network, name, "bf16")(IMAGE) - network(IMAGE)).abs().max()
    assert difference < 0.05
    assert name == "openvino" or difference > 1e-5  # OpenVINO leaves it out on CPUs without it


def test_a_blank_image_has_a_point_or_so():
    for each in installed_runtimes(tiny_network()):
        assert len(PointSelector().select(each, torch.full((1, 1, 40, 51), 77.0), 1000)) <= 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "tensorrt"}, "runtime is tensorrt: give one of torch, onnxruntime, openvino, auto"),
        ({"precision": 16}, "precision is 16: give one of 32, bf16"),
        ({"name": "onnxruntime", "precision": "bf16"}, "onnxruntime has no bfloat16"),
    ],
)
def test_what_there_is_not_is_refused(options, message):
    with pytest.raises(BadInputError, match=message):
        make_runtime(tiny_network(), **options)


@pytest.mark.parametrize("name", ["onnxruntime", "openvino"])
def test_a_runtime_that_is_not_installed_is_named_with_the_command(monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(BadInputError, match=rf"runtime={name} needs .* {name}: pip install 'sips_lit\[runtimes\]'"):
        make_runtime(tiny_network(), name)


def test_other_runtimes_are_of_the_cpu():
    with pytest.raises(BadInputError, match="runtime=openvino runs on the CPU"):
        make_runtime(tiny_network().to("meta"), "openvino")
    assert isinstance(make_runtime(tiny_network().to("meta"), "auto"), TorchRuntime)


class Slow:
    """Takes so many seconds, by a clock of its own."""

    scales, scale_factor, now = 1, 2.0, 0.0

    def __init__(self, name: str, *seconds: float) -> None:
        self.name, self.seconds, self.calls = name, list(seconds), 0

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        Slow.now += self.seconds[min(self.calls, len(self.seconds) - 1)]
        self.calls += 1
        return image


def test_auto_takes_the_fastest_once_it_is_warm_and_measures_each_size_once():
    runtimes = [Slow("a", 1, 5), Slow("b", 100, 9, 4, 9)]  # b compiles, and is disturbed twice
    fastest = Fastest(tiny_network(), runtimes=runtimes, clock=lambda: Slow.now)
    fastest(IMAGE)
    assert [each.calls for each in runtimes] == [4, 5]
    Fastest(tiny_network(), runtimes=runtimes, clock=lambda: Slow.now)(IMAGE)  # another one of the same network
    assert [each.calls for each in runtimes] == [4, 6]
    fastest(IMAGE[..., :5, :5])
    assert [each.calls for each in runtimes] == [9, 10]  # of this size a is the fastest


def test_auto_without_others_measures_nothing(monkeypatch):
    monkeypatch.setattr(runtime, "find_spec", lambda name: None)
    fastest = make_runtime(tiny_network(), "auto")
    assert [each.name for each in fastest.runtimes] == ["torch"]
    assert torch.equal(fastest(IMAGE), TorchRuntime(tiny_network())(IMAGE))


def test_the_weights_of_an_onnx_session_are_those_of_its_making():
    network = tiny_network()
    session, live = OnnxRuntime(network), TorchRuntime(network)
    before = live(IMAGE)
    with torch.no_grad():
        network.layers[-1].bias.add_(1)
    torch.testing.assert_close(session(IMAGE), before)
    torch.testing.assert_close(live(IMAGE), before + 1)
