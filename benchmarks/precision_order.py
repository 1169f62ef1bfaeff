"""Whether bfloat16 changes which points are best: float32 against autocast to bfloat16, on the same images.

    python benchmarks/precision_order.py CHECKPOINT PATH [--images 10]          PATH: a folder of images

Tells, for several n, the share of the n best points that both have (within a pixel), and the rank correlation (Spearman) of
the logits at the 500 best points of float32.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tabulate import tabulate
from torchmetrics.functional import spearman_corrcoef

from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.selection import SelectedPoints, image_tensor
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import list_images

POINTS = (10, 20, 50, 100, 200)
MANY = 500


def share_of_both(one: NDArray[np.float32], other: NDArray[np.float32], n: int) -> float:
    """The share of the n best points (N, 2) that have one of the n best others within a pixel."""
    apart = np.linalg.norm(one[:n, None] - other[None, :n], axis=2)
    return float((apart.min(axis=1, initial=np.inf) <= 1).mean())


@torch.no_grad()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("path", type=Path)
    parser.add_argument("--images", type=int, default=10)
    given = parser.parse_args()
    network, selector = load_checkpoint(given.checkpoint)
    files = list_images(given.path)
    shares: dict[int, list[float]] = {n: [] for n in POINTS}
    correlations = []
    for file in files[:: max(1, len(files) // given.images)][: given.images]:
        image = image_tensor(read_grey(file))
        found: list[SelectedPoints] = []
        maps = []
        for reduced in (False, True):
            with torch.autocast("cpu", torch.bfloat16, enabled=reduced):
                found.append(selector.select(network, image, MANY))
                maps.append(network(image)[0, 0].numpy())
        for n in POINTS:
            shares[n].append(share_of_both(found[0].keypoints.xy, found[1].keypoints.xy, n))
        at = found[0].row, found[0].column
        correlations.append(float(spearman_corrcoef(*(torch.from_numpy(scores[at]) for scores in maps))))
    print(tabulate([[n, np.mean(values), np.min(values)] for n, values in shares.items()], ["n", "mean", "least"]))
    print(f"rank correlation of the logits at the {MANY} best points: {np.mean(correlations):.4f}")


if __name__ == "__main__":
    main()
