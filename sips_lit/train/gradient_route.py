"""Which route a gradient takes: through receptive fields or through whole images, whichever takes less time here.

Receptive fields cost by the point, whole images by the pixel; what they cost hangs on the network and on the machine. So
both are measured once, on the first images of a training, and remembered for the next.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import torch
from torch import Tensor

from sips_lit.detect.score_network import Gradient, ScoreNetwork
from sips_lit.detect.selection import SelectedPoints, logits_at
from sips_lit.detect.turns import least_seconds
from sips_lit.errors import warn_input
from sips_lit.files import make_folder, write_whole


@dataclass(frozen=True, slots=True)
class RouteCosts:
    """Seconds that forward and backward take: a ``pixel`` of whole images, and a ``point`` by its receptive field."""

    pixel: float
    point: float

    def faster(self, images: Sequence[Tensor], points: Sequence[SelectedPoints]) -> Gradient:
        """The route that takes less time for the selected points of images (1, 1, H, W)."""
        whole = self.pixel * sum(image.numel() for image in images)
        return "dense" if whole < self.point * sum(map(len, points)) else "patches"

    def __str__(self) -> str:
        return (
            f"{1e3 * self.point:.2g} ms a point by its receptive field, {1e6 * self.pixel:.2g} us a pixel of whole images: "
            f"whole images where they have fewer than {self.point / self.pixel:.0f} pixels a point"
        )


def measured_costs(
    network: ScoreNetwork,
    images: Sequence[Tensor],
    points: Sequence[SelectedPoints],
    clock: Callable[[], float] = time.perf_counter,
) -> RouteCosts:
    """What each route costs for these images (1, 1, H, W) and points. No gradient is kept."""
    weights = [weight for weight in network.parameters() if weight.requires_grad]

    def run(route: Gradient) -> None:
        logits = logits_at(network, images, points, route)
        torch.autograd.grad(torch.cat(logits).sum(), weights, allow_unused=True)
        if images[0].device.type == "cuda":
            torch.cuda.synchronize(images[0].device)

    taken = least_seconds({route: partial(run, route) for route in get_args(Gradient)}, clock)
    pixels, count = sum(image.numel() for image in images), sum(map(len, points))
    return RouteCosts(taken["dense"] / pixels, taken["patches"] / count)


def setting(network: ScoreNetwork, device: torch.device, precision: str, compiled: bool) -> str:
    """What costs hold for: the network's shape, the device and its threads, precision, and the version of PyTorch."""
    shape = {name: network.config[name] for name in ("depth", "width", "derivatives", "scales")}
    where = torch.cuda.get_device_name(device) if device.type == "cuda" else f"{torch.get_num_threads()} threads"
    whole = {**shape, "compiled": compiled, "device": f"{device.type}, {where}", "precision": precision}
    return json.dumps({**whole, "torch": torch.__version__}, sort_keys=True)


class RememberedCosts:
    """Costs by `setting` in a file, so that a later training need not measure; None: in no file.

    A file that can't be read is told of, and replaced.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path

    def get(self, of: str) -> RouteCosts | None:
        """The costs of that setting; None where they were never measured."""
        return self._read().get(of)

    def put(self, of: str, costs: RouteCosts) -> None:
        """Stores the costs of a setting. Raises StorageError when they can't be written."""
        if self.path is None:
            return
        known = {name: asdict(each) for name, each in {**self._read(), of: costs}.items()}
        make_folder(self.path.parent)
        write_whole(self.path, json.dumps(known, indent=1).encode())

    def _read(self) -> dict[str, RouteCosts]:
        if self.path is None or not self.path.exists():
            return {}
        try:
            known = {of: RouteCosts(**costs) for of, costs in json.loads(self.path.read_text("utf-8")).items()}
            if all(0 < cost < math.inf for costs in known.values() for cost in (costs.pixel, costs.point)):
                return known
        except (OSError, ValueError, TypeError, AttributeError):
            pass
        warn_input(f"{self.path} is damaged: what routes of the gradient cost is measured again")
        return {}
