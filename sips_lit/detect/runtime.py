"""What executes the score network: PyTorch, ONNX Runtime, OpenVINO, or whichever is fastest for the size of the image."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from threading import Lock
from typing import Any, Final, Literal, Protocol, get_args

import torch
from torch import Tensor

from sips_lit.detect.checkpoint import digest_of
from sips_lit.detect.detection_logits import detection_logits
from sips_lit.detect.folding import block_side, whole_blocks
from sips_lit.detect.onnx_graph import EXTRA, onnx_graph
from sips_lit.detect.openvino_package import openvino_core
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import Scorer
from sips_lit.detect.strips import logits_by_strips
from sips_lit.detect.turns import least_seconds
from sips_lit.errors import BadInputError, import_extra, warn_input

RuntimeName = Literal["torch", "onnxruntime", "openvino", "auto"]
Precision = Literal["32", "bf16"]

SIZES_KEPT: Final = 16
"""Image sizes that OpenVINO keeps its models of: it is a fifth faster where it knows the size."""
_PACKAGES: Final[dict[str, tuple[str, ...]]] = {
    "onnxruntime": ("onnx", "onnxruntime"),
    "openvino": ("onnx", "openvino"),
}


class ScoreRuntime(Scorer, Protocol):
    """A score network that can be run but not trained: its logits have no gradient."""

    @property
    def name(self) -> str:
        """What executes it."""


def make_runtime(network: ScoreNetwork, name: str = "torch", precision: str | int = "32") -> ScoreRuntime:
    """The runtime of that name: torch, onnxruntime, openvino, or auto.

    ``precision``: 32, or bf16, which halves the time on a CPU that has it and moves logits by some hundredths. Different
    runtimes differ by 1e-6 or so of a logit, which may swap points that are as good as equal. All but torch use the
    weights that the network has now, and run on the CPU.

    Raises BadInputError for an unknown name or precision, a combination that there is not, and where the runtime is not
    installed.
    """
    if name not in get_args(RuntimeName):
        raise BadInputError(f"runtime is {name}: give one of {', '.join(get_args(RuntimeName))}")
    if str(precision) not in get_args(Precision):
        raise BadInputError(f"precision is {precision}: give one of {', '.join(get_args(Precision))}")
    bf16, on_cpu = str(precision) == "bf16", next(network.parameters()).device.type == "cpu"
    if not on_cpu and name in _PACKAGES:
        raise BadInputError(f"runtime={name} runs on the CPU: give device=cpu with it, or runtime=torch")
    if bf16 and name == "onnxruntime":
        raise BadInputError("onnxruntime has no bfloat16 on a CPU: give precision=32, or runtime=openvino or torch")
    match name:
        case "onnxruntime":
            return OnnxRuntime(network)
        case "openvino":
            return OpenVino(network, bf16)
        case "auto" if on_cpu:
            return Fastest(network, bf16)
        case _:
            return TorchRuntime(network, bf16)


class TorchRuntime:
    """PyTorch, on the network's device; where that is a CPU by strips, and narrow networks on blocks of pixels."""

    name = "torch"

    def __init__(self, network: ScoreNetwork, bf16: bool = False) -> None:
        self.network, self.bf16 = network, bf16
        self.scales, self.scale_factor = network.scales, network.scale_factor

    @torch.no_grad()
    def __call__(self, image: Tensor) -> Tensor:
        """See `Scorer`."""
        with torch.autocast(image.device.type, torch.bfloat16, enabled=self.bf16):
            if image.device.type == "cpu":
                return logits_by_strips(self.network, image)
            return self.network(image)  # type: ignore[no-any-return]


class _Exported:
    """What runtimes share that take an ONNX graph: whole blocks in, the image's own pixels out."""

    name: str

    def __init__(self, network: ScoreNetwork) -> None:
        self.scales, self.scale_factor = network.scales, network.scale_factor
        self.detection = network.detection
        self.side, self.model = block_side(network), onnx_graph(network)

    def __call__(self, image: Tensor) -> Tensor:
        """See `Scorer`."""
        return detection_logits(self._octave, image.detach().float(), self.detection)

    def _octave(self, image: Tensor) -> Tensor:
        blocks = whole_blocks(image, self.side).contiguous().numpy()
        return torch.from_numpy(self._run(blocks))[..., : image.shape[-2], : image.shape[-1]].contiguous()

    def _run(self, image: Any) -> Any:
        raise NotImplementedError


class OnnxRuntime(_Exported):
    """ONNX Runtime on the CPU, with as many threads as PyTorch has. Raises BadInputError where it is not installed."""

    name = "onnxruntime"

    def __init__(self, network: ScoreNetwork) -> None:
        onnxruntime = import_extra("onnxruntime", EXTRA, "runtime=onnxruntime")
        super().__init__(network)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        self.session = onnxruntime.InferenceSession(self.model, options, providers=["CPUExecutionProvider"])

    def _run(self, image: Any) -> Any:
        return self.session.run(["logits"], {"image": image})[0]


class OpenVino(_Exported):
    """OpenVINO on the CPU, with as many threads as PyTorch has. Raises BadInputError where it is not installed.

    A model is compiled for each size of images when the first comes, in some tenths of a second. Threads take turns. Warns
    of bfloat16 on a processor without it.
    """

    name = "openvino"

    def __init__(self, network: ScoreNetwork, bf16: bool = False) -> None:
        self.core = openvino_core("runtime=openvino")
        super().__init__(network)
        if bf16 and "BF16" not in self.core.get_property("CPU", "OPTIMIZATION_CAPABILITIES"):
            warn_input("this processor has no instructions for bfloat16: OpenVINO computes in float32")
        self.options = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_NUM_THREADS": torch.get_num_threads(),
            "INFERENCE_PRECISION_HINT": "bf16" if bf16 else "f32",  # left alone it takes bf16 where the CPU has it
        }
        self._compiled: OrderedDict[tuple[int, ...], Any] = OrderedDict()
        self._turn = Lock()

    def _compile(self, shape: tuple[int, ...]) -> Any:
        model = self.core.read_model(self.model)
        model.reshape({"image": list(shape)})
        return self.core.compile_model(model, "CPU", self.options).create_infer_request()

    def _run(self, image: Any) -> Any:
        with self._turn:  # a request has one memory, which threads would share
            if image.shape not in self._compiled:
                self._compiled[image.shape] = self._compile(image.shape)
            self._compiled.move_to_end(image.shape)
            while len(self._compiled) > SIZES_KEPT:
                self._compiled.popitem(last=False)
            return self._compiled[image.shape].infer({"image": image})[0]  # a copy: the request uses its memory again


class Fastest:
    """The fastest of several runtimes for images of each size, measured when the first image of a size comes.

    What was measured once holds for the process. Which one wins may differ between two runs, and so may last digits.
    """

    def __init__(
        self,
        network: ScoreNetwork,
        bf16: bool = False,
        runtimes: Sequence[ScoreRuntime] | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.scales, self.scale_factor = network.scales, network.scale_factor
        self.runtimes = installed_runtimes(network, bf16) if runtimes is None else list(runtimes)
        self.key, self._clock = (digest_of(network), bf16, torch.get_num_threads()), clock

    @property
    def name(self) -> str:
        """Those that there are to choose from."""
        return f"auto ({', '.join(runtime.name for runtime in self.runtimes)})"

    def __call__(self, image: Tensor) -> Tensor:
        """See `Scorer`."""
        return self.chosen(image)(image)

    def chosen(self, image: Tensor) -> ScoreRuntime:
        """The runtime for images of this size: the one that took the `least_seconds`."""
        if len(self.runtimes) == 1:
            return self.runtimes[0]
        key = (*self.key, tuple(image.shape))
        if key not in _FASTEST:
            times = least_seconds({each.name: partial(each, image) for each in self.runtimes}, self._clock)
            _FASTEST[key] = min(times, key=times.__getitem__)
        return next(runtime for runtime in self.runtimes if runtime.name == _FASTEST[key])


_FASTEST: Final[dict[tuple[Any, ...], str]] = {}
"""Names of runtimes by network, precision, threads and the shape of the image."""


def installed_runtimes(network: ScoreNetwork, bf16: bool = False) -> list[ScoreRuntime]:
    """Those that can run the network on this machine's CPU, torch first."""
    runtimes: list[ScoreRuntime] = [TorchRuntime(network, bf16)]
    for name, packages in _PACKAGES.items():
        if all(find_spec(package) for package in packages) and not (bf16 and name == "onnxruntime"):
            runtimes.append(make_runtime(network, name, "bf16" if bf16 else "32"))
    return runtimes
