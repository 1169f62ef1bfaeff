"""What `module.compiled=true` gains: a training step of each model with and without it, and how long it takes to compile.

    python benchmarks/compiled_step.py [MODEL ...]            files of conf/model; tiny and small if none is given

A step selects 500 points in each of two 640x480 images and has the gradient of their logits, by patches. Both networks take
turns; the least of the times counts: of the processor, on a GPU those of the clock. On a GPU it is in bfloat16.
"""

from __future__ import annotations

import os
import sys
import time
from copy import deepcopy

import torch
import torch.nn.functional as F
from network_time import network_of
from tabulate import tabulate
from torch import Tensor

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, logits_at
from sips_lit.train.compiled import compile_layers

os.environ["TORCHINDUCTOR_FORCE_DISABLE_CACHES"] = "1"  # what an earlier run compiled would take no time
DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
ROUNDS, POINTS = 7, 500


def step(network: ScoreNetwork, images: list[Tensor], together: bool) -> None:
    with torch.autocast(DEVICE.type, torch.bfloat16, enabled=DEVICE.type == "cuda"):
        batches = [torch.cat(images)] if together else images
        points = [points for batch in batches for points in PointSelector().select_each(network, batch, POINTS)]
        logits = logits_at(network, images, points, "patches")
        loss = F.softplus(torch.cat(logits)).sum()
    network.zero_grad()
    loss.backward()


def seconds(network: ScoreNetwork, images: list[Tensor], together: bool = False) -> float:
    """Of a step whose images are selected in one after the other, or together."""
    clock = time.perf_counter if DEVICE.type == "cuda" else time.process_time
    start = clock()
    step(network, images, together)
    if DEVICE.type == "cuda":
        torch.cuda.synchronize()
    return clock() - start


def main() -> None:
    torch.manual_seed(0)
    images = [255 * F.avg_pool2d(torch.rand(1, 1, 480, 640, device=DEVICE), 5, 1, 2) for _ in range(2)]
    rows = []
    for name in sys.argv[1:] or ["tiny", "small"]:
        plain = network_of(name).train().to(DEVICE)
        compiled = deepcopy(plain)
        compile_layers(compiled)
        start = time.perf_counter()
        step(compiled, images, together=False)
        to_compile = time.perf_counter() - start
        turns = [(seconds(plain, images), seconds(compiled, images)) for _ in range(ROUNDS)]
        without, with_it = (1e3 * min(times) for times in zip(*turns, strict=True))
        rows.append([name, without, with_it, without / with_it, to_compile])
    print(f"{DEVICE}, {torch.get_num_threads()} threads, PyTorch {torch.__version__}")
    print(
        tabulate(
            rows, ["model", "ms a step", "compiled", "gain", "s to compile"], floatfmt=("", ".0f", ".0f", ".2f", ".0f")
        )
    )


if __name__ == "__main__":
    main()
