"""What a forward pass of each network costs: processor time of a 640x480 image, in turns, against `small`.

    python benchmarks/network_time.py [OVERRIDES ...]         for instance: small tiny 'small derivatives=false'

An argument is a file of conf/model with keys that differ.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from tabulate import tabulate

from sips_lit.detect.score_network import ScoreNetwork

DEFAULT = ["small", "small derivatives=false", "tiny"]
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
    image = 255 * torch.rand(1, 1, 480, 640)
    spent: dict[str, list[float]] = {argument: [] for argument in networks}
    for _ in range(ROUNDS):
        for argument, network in networks.items():
            start = time.process_time()
            network(image)
            spent[argument].append(1e3 * (time.process_time() - start))
    first = statistics.median(next(iter(spent.values())))
    rows = [
        [argument, sum(p.numel() for p in networks[argument].parameters()), ms := statistics.median(times), ms / first]
        for argument, times in spent.items()
    ]
    print(f"{torch.get_num_threads()} threads, float32")
    print(tabulate(rows, ["network", "weights", "ms of processor time", "against the first"], floatfmt=".2f"))


if __name__ == "__main__":
    main()
