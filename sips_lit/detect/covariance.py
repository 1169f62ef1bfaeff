"""How surely a point is where it is: the 2 x 2 covariance of its place, from three numbers of the network.

Standard deviations by their logarithms and the correlation by its hyperbolic tangent give a covariance for any three real
numbers (Nix and Weigend, ICNN 1994, for one dimension; Kendall and Gal, NeurIPS 2017, in networks). Bounds are our choice.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, cast

import numpy as np
import torch
from torch import Tensor

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import SelectedPoints, image_pyramid
from sips_lit.types import Keypoints

LARGEST_LOG_SIGMA: Final = 4.0
"""Standard deviations stay between 0.02 and 55 pixels of the image that the network sees."""
LARGEST_CORRELATION: Final = 0.99
"""A covariance can be inverted in float32."""


def covariance_matrices(numbers: Tensor) -> Tensor:
    """Covariances (..., 2, 2) in pixels squared of (..., 3) numbers: log sigma_x, log sigma_y, atanh of the correlation."""
    sigma = numbers[..., :2].clamp(-LARGEST_LOG_SIGMA, LARGEST_LOG_SIGMA).exp()
    mixed = LARGEST_CORRELATION * numbers[..., 2].tanh() * sigma[..., 0] * sigma[..., 1]
    rows = torch.stack([sigma[..., 0] ** 2, mixed], -1), torch.stack([mixed, sigma[..., 1] ** 2], -1)
    return torch.stack(rows, -2)


def covariances_at(network: ScoreNetwork, image: Tensor, points: SelectedPoints) -> Tensor:
    """Covariances (N, 2, 2) of the selected points of one image (1, 1, H, W), in its pixels squared, in their order.

    Those of coarse levels of the pyramid grow with their pixels. Only the head gets a gradient.
    """
    levels = image_pyramid(image, network.scales, network.scale_factor)
    covariance = image.new_zeros(len(points), 2, 2)
    for index in np.unique(points.level):
        here = np.flatnonzero(points.level == index)
        rows, columns = (torch.from_numpy(place[here]).to(image.device) for place in (points.row, points.column))
        matrices = covariance_matrices(network.covariance_numbers(levels[index], rows, columns))
        covariance[torch.from_numpy(here).to(image.device)] = matrices * network.scale_factor ** (2 * int(index))
    return covariance


@torch.no_grad()
def with_covariance(network: ScoreNetwork, image: Tensor, points: SelectedPoints) -> Keypoints:
    """The keypoints of selected points, with their covariances if the network has the head for it."""
    if network.covariance_head is None:
        return points.keypoints
    return replace(points.keypoints, covariance=covariances_at(network, image, points).cpu().numpy())


@torch.no_grad()
def scale_covariances(network: ScoreNetwork, factor: float) -> None:
    """Multiplies all covariances of a network by a positive ``factor``: half its logarithm goes to the head's bias.

    Raises ValueError for a network without the head, and for another factor.
    """
    if network.covariance_head is None or not 0 < factor < math.inf:
        raise ValueError(
            f"covariances can't be multiplied by {factor}: that takes a covariance head and a number above 0"
        )
    cast(Tensor, network.covariance_head.bias)[:2] += math.log(factor) / 2
