"""What `module.pairs_at_once` gains: milliseconds of the network for each pair, of which it sees 1, 2, 4 or 8 together.

    python benchmarks/pairs_at_once.py [MODEL ...]            files of conf/model; tiny and small if none is given

A pair is 500 points in each of two 640x480 images, selected from one image after the other, or of several pairs from all
together; the gradient of the logits of all is by patches. The numbers of pairs take turns; the least of the times counts, as
in compiled_step.py.
"""

from __future__ import annotations

import sys

import torch
import torch.nn.functional as F
from compiled_step import DEVICE, ROUNDS, seconds
from network_time import network_of
from tabulate import tabulate

TOGETHER = 1, 2, 4, 8


def main() -> None:
    torch.manual_seed(0)
    images = [255 * F.avg_pool2d(torch.rand(1, 1, 480, 640, device=DEVICE), 5, 1, 2) for _ in range(2 * max(TOGETHER))]
    rows = []
    for name in sys.argv[1:] or ["tiny", "small"]:
        network = network_of(name).train().to(DEVICE)
        for pairs in TOGETHER:
            seconds(network, images[: 2 * pairs], pairs > 1)  # memory and kernels are found
        turns = [
            [seconds(network, images[: 2 * pairs], pairs > 1) / pairs for pairs in TOGETHER] for _ in range(ROUNDS)
        ]
        rows.append([name, *(1e3 * min(times) for times in zip(*turns, strict=True))])
    print(f"{DEVICE}, {torch.get_num_threads()} threads, PyTorch {torch.__version__}; ms a pair")
    print(tabulate(rows, ["model", *(f"{pairs} at once" for pairs in TOGETHER)], "pipe", floatfmt=".0f"))


if __name__ == "__main__":
    main()
