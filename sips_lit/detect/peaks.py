"""Peaks of a score map: non-maximum suppression with an exact radius and deterministic ties, and a sub-pixel fit."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

_SINGLE: Final = 2**24
"""Up to it float32 tells all whole numbers apart."""
_AROUND: Final = np.array([-1, 0, 1])


def local_maxima(scores: Tensor, radius: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns, each (N,) int64, of the local maxima of a score map (H, W), best first.

    A pixel is a maximum if no pixel within Chebyshev distance ``radius`` scores higher, and is kept if no equal maximum
    within that distance comes earlier in raster order. So no two kept pixels are closer than or equal to ``radius``, and
    equal scores give the same points on every machine.
    Kept pixels are ordered by score, then row, then column. Pixels that are NaN or -inf are never kept.

    On a CPU OpenCV finds the maximum of each window, in a third of PyTorch's time.
    """
    if scores.device.type == "cpu":
        known = scores.detach() if scores.dtype in (torch.float32, torch.float64) else scores.detach().double()
        places = _maxima_on_cpu(known.contiguous().numpy(), radius)
    else:
        places = _maxima_on_device(scores, radius).cpu().numpy()
    return np.divmod(places, scores.shape[1])


def _maxima_on_cpu(scores: NDArray[Any], radius: int) -> NDArray[np.int64]:
    """Places (N,) in raster order's count, best first."""
    if scores.size and np.isnan(scores.max()):
        scores = np.where(np.isnan(scores), scores.dtype.type(-np.inf), scores)
    window = np.ones((2 * radius + 1,) * 2, np.uint8)
    flat = scores.ravel()
    places = np.flatnonzero(scores == cv2.dilate(scores, window))
    places = places[flat[places] > -np.inf]
    places = places[np.argsort(-flat[places], kind="stable")]
    values = flat[places]
    if (values[1:] == values[:-1]).any():
        # maxima within the radius of each other have equal scores: keep those that come first in raster order
        earliness = np.full(scores.shape, -np.inf, np.float32 if scores.size <= _SINGLE else np.float64)
        earliness.ravel()[places] = -places
        places = places[cv2.dilate(earliness, window).ravel()[places] == -places]
    return places


def _maxima_on_device(scores: Tensor, radius: int) -> Tensor:
    """The same in PyTorch."""
    candidates = (scores == _window_max(scores, radius)) & (scores > -torch.inf)
    places = _best_first(scores, candidates)
    values = scores.flatten()[places]
    if bool((values[1:] == values[:-1]).any()):
        earliness = -torch.arange(scores.numel(), device=scores.device, dtype=torch.float64).reshape(scores.shape)
        earliness = earliness.masked_fill(~candidates, -torch.inf)
        places = _best_first(scores, candidates & (earliness == _window_max(earliness, radius)))
    return places


def quadratic_offsets(scores: Tensor, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Offsets (N, 2) as (dx, dy) from each peak pixel to the top of the quadratic through its 3x3 neighbourhood.

    Fit on logits, not on probabilities: the sigmoid flattens strong peaks. Gradient and Hessian are central differences;
    the step is Newton's, cut to half a pixel. It is zero where the neighbourhood has no proper top (the Hessian is not
    negative definite, or a value is not finite) and at the border of the map (H, W).
    """
    height, width = scores.shape
    if height < 3 or width < 3:
        return np.zeros((len(rows), 2))
    inside = (rows > 0) & (rows < height - 1) & (columns > 0) & (columns < width - 1)
    middle = np.minimum(np.maximum(rows, 1), height - 2) * width + np.minimum(np.maximum(columns, 1), width - 2)
    around = middle + (_AROUND[:, None] * width + _AROUND).reshape(-1, 1)
    values = scores.detach().flatten()[torch.from_numpy(around).to(scores.device)]
    return _newton_step(values.cpu().double().numpy(), inside)


def _newton_step(values: NDArray[np.float64], inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N, 2) of neighbourhoods (9, N) in raster order: a few numbers, for which NumPy takes a third of PyTorch's time."""
    (nw, north, ne, west, centre, east, sw, south, se) = values
    with np.errstate(divide="ignore", invalid="ignore"):
        gx, gy = (east - west) / 2, (south - north) / 2
        xx, yy = east - 2 * centre + west, south - 2 * centre + north
        xy = (se - ne - sw + nw) / 4
        determinant = xx * yy - xy * xy
        step = np.stack([xy * gy - yy * gx, xy * gx - xx * gy], 1) / determinant[:, None]
        proper = inside & (xx < 0) & (determinant > 0) & np.isfinite(step).all(1)
    return np.where(proper[:, None], step.clip(-0.5, 0.5), 0.0)


def _best_first(scores: Tensor, chosen: Tensor) -> Tensor:
    places = torch.nonzero(chosen.flatten())[:, 0]  # in raster order
    return places[torch.sort(scores.flatten()[places], descending=True, stable=True).indices]


def _window_max(x: Tensor, radius: int) -> Tensor:
    """Maximum over the (2 radius + 1)^2 window around each element of (H, W); NaN counts as -inf."""
    x = torch.nan_to_num(x, nan=-torch.inf, posinf=torch.inf, neginf=-torch.inf)
    return _row_max(_row_max(x, radius).T, radius).T


def _row_max(x: Tensor, radius: int) -> Tensor:
    """Sliding maximum along the rows by doubling the span: log2(window) passes, far faster than max-pooling."""
    window, span = 2 * radius + 1, 1
    x = F.pad(x, (radius, radius), value=-torch.inf)
    while span < window:
        step = min(span, window - span)
        x = torch.maximum(x[:, :-step], x[:, step:])
        span += step
    return x
