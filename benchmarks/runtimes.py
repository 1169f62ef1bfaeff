"""A forward pass of a network by each runtime and precision, against plain float32 convolutions in NCHW.

    python benchmarks/runtimes.py [MODEL] [--size 640 480] [--rounds 7]        MODEL: a file of conf/model; default: paper

All take turns on two threads; the median counts, and the least. Wanted of `paper`: at most 0.35 of the plain time by one of
them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from network_time import network_of
from tabulate import tabulate
from torch import Tensor

from sips_lit.detect.detection_logits import Detection
from sips_lit.detect.runtime import make_runtime
from sips_lit.detect.score_network import ScoreNetwork

WANTED = 0.35


def plain(network: ScoreNetwork) -> Callable[[Tensor], Tensor]:
    """The layers one after the other on whole images in NCHW: for networks that score the grey image alone."""
    if network.derivatives or network.detection != Detection():
        raise SystemExit("only networks without derivatives, octaves and corners are plain: give paper, say")
    weights = [(layer.weight.detach().contiguous(), layer.bias.detach()) for layer in network.layers]  # type: ignore[union-attr,operator]

    def forward(image: Tensor) -> Tensor:
        x = network.pad(image)
        for weight, bias in weights[:-1]:
            x = F.leaky_relu(F.conv2d(x, weight, bias), network.leaky_slope)
        return F.conv2d(x, *weights[-1])

    return forward


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="paper")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    torch.set_num_threads(2)
    torch.manual_seed(0)
    network = network_of(arguments.model).eval()
    image = 255 * torch.rand(1, 1, *reversed(arguments.size))
    ways = [(name, precision) for name in ("torch", "onnxruntime", "openvino") for precision in ("32", "bf16")]
    ways.remove(("onnxruntime", "bf16"))  # which it does not have
    passes = {"plain float32, NCHW": plain(network)}
    passes |= {f"{name}, {precision}": make_runtime(network, name, precision) for name, precision in ways}
    taken: dict[str, list[float]] = {name: [] for name in passes}
    with torch.no_grad():
        for _ in range(arguments.rounds + 1):  # in the first models are compiled
            for name, forward in passes.items():
                start = time.perf_counter()
                forward(image)
                taken[name].append(1000 * (time.perf_counter() - start))
    figures = [(np.median(times[1:]), min(times[1:])) for times in taken.values()]
    rows = [[name, *found, *np.divide(found, figures[0])] for name, found in zip(taken, figures, strict=True)]
    columns = [arguments.model, "median ms", "least ms", "of the plain median", "of the plain least"]
    print(f"{arguments.size[0]}x{arguments.size[1]}, 2 threads, PyTorch {torch.__version__}")
    print(tabulate(rows, columns, "pipe", floatfmt=("", ".0f", ".0f", ".2f", ".2f")))
    print(f"least: {min(row[3] for row in rows):.2f} of the plain median (wanted of paper: {WANTED})")


if __name__ == "__main__":
    main()
