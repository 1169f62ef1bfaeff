"""What each network costs on a 640x480 image: processor time of a forward pass, and of 500 points with every scale of it.

The least of many turns, in which the networks take part one after the other, and its ratio to the first network's.

    python benchmarks/network_time.py [OVERRIDES ...]         for instance: small tiny 'small derivatives=false'

An argument is a file of conf/model with keys that differ.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from tabulate import tabulate

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector

DEFAULT = ["small", "small octaves=1", "small corners=0", "small derivatives=false", "small scales=5", "tiny"]
ROUNDS = 11


def network_of(argument: str) -> ScoreNetwork:
    """The network of a model's name and overrides."""
    name, *overrides = argument.split()
    stored = Path(__file__).parents[1] / "conf" / "model" / f"{name}.yaml"
    network: ScoreNetwork = instantiate(OmegaConf.merge(OmegaConf.load(stored), OmegaConf.from_dotlist(overrides)))
    return network.eval()


@torch.no_grad()
def main() -> None:
    torch.manual_seed(0)
    networks = {argument: network_of(argument) for argument in sys.argv[1:] or DEFAULT}
    image, selector = 255 * torch.rand(1, 1, 480, 640), PointSelector()
    forward: dict[str, list[float]] = {argument: [] for argument in networks}
    points: dict[str, list[float]] = {argument: [] for argument in networks}
    for _ in range(ROUNDS):
        for argument, network in networks.items():
            network(image)  # its memory and caches
            start = time.process_time()
            network(image)
            between = time.process_time()
            selector.select(network, image, 500)
            forward[argument].append(1e3 * (between - start))
            points[argument].append(1e3 * (time.process_time() - between))
    first = next(iter(networks))
    rows = [
        [name, sum(p.numel() for p in network.parameters())]
        + [value for times in (forward, points) for value in (min(times[name]), min(times[name]) / min(times[first]))]
        for name, network in networks.items()
    ]
    print(f"{torch.get_num_threads()} threads, float32, ms of processor time and its ratio to the first")
    print(tabulate(rows, ["network", "weights", "forward", "ratio", "500 points", "ratio"], floatfmt=".2f"))


if __name__ == "__main__":
    main()
