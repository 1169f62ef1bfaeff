"""What `module.gradient=auto` gains: milliseconds of both routes for 1000 points of two images, at several sizes.

    python benchmarks/gradient_route.py [MODEL ...]            files of conf/model; tiny and small if none is given

`auto` measures once, as in a training, on the images of the first size, and chooses by that for all others.
"""

from __future__ import annotations

import sys

import torch
import torch.nn.functional as F
from compiled_step import DEVICE
from network_time import network_of
from tabulate import tabulate

from sips_lit.detect.selection import OneOctave, PointSelector, SelectedPoints
from sips_lit.train.gradient_route import RouteCosts, measured_costs

SIZES = (640, 480), (1241, 376), (416, 128), (320, 240), (160, 120)
POINTS = 500


def main() -> None:
    torch.manual_seed(0)
    selector, rows = PointSelector().anywhere, []
    for name in sys.argv[1:] or ["tiny", "small"]:
        network = network_of(name).train().to(DEVICE)
        known: RouteCosts | None = None
        for width, height in SIZES:
            images = [255 * F.avg_pool2d(torch.rand(1, 1, height, width, device=DEVICE), 5, 1, 2) for _ in range(2)]
            points: list[SelectedPoints] = [selector.select(OneOctave(network), image, POINTS) for image in images]
            costs = measured_costs(network, images, points)
            known = known or costs
            count = sum(map(len, points))
            dense, patches = 1e3 * costs.pixel * 2 * width * height, 1e3 * costs.point * count
            rows.append([name, f"{width} x {height}", count, patches, dense, known.faster(images, points)])
    print(f"{DEVICE}, {torch.get_num_threads()} threads, PyTorch {torch.__version__}; ms a pair")
    print(tabulate(rows, ["model", "images", "points", "patches", "dense", "auto takes"], "pipe", floatfmt=".0f"))


if __name__ == "__main__":
    main()
