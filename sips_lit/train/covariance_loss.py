"""The loss of covariances: how likely the residuals of inlier matches are under what the network says of both points."""

from __future__ import annotations

import torch
from torch import Tensor


def residual_covariances(own: Tensor, other: Tensor, zoom: Tensor) -> Tensor:
    """Covariances (M, 2, 2) of M residuals, in pixels of the other image, of those of the points on both sides (M, 2, 2).

    A residual leads from the matched point to where the own point truly moves. Both places are off by independent errors,
    and the motion between the images moves the own error along, so the residual is their difference and the covariances
    add (Hartley and Zisserman, Multiple View Geometry, 5.2). Ours: that motion is taken to be locally a shift, but for
    images of different size, of which ``zoom`` (2,) = (width, height) of the other over the own; and the label as exact,
    so what it is off by counts as uncertainty of the points.
    """
    return own * zoom[:, None] * zoom + other


def gaussian_nll(residual: Tensor, covariance: Tensor) -> Tensor:
    """-log of the normal density (M,), in nats, of residuals (M, 2) under covariances (M, 2, 2), without log(2 pi).

    A proper scoring rule: in the mean it is least for the true covariance (Gneiting and Raftery, JASA 2007).
    """
    a, b, d = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    determinant = a * d - b * b
    x, y = residual[:, 0], residual[:, 1]
    squared = (d * x * x - 2 * b * x * y + a * y * y) / determinant
    return (squared + torch.log(determinant)) / 2
