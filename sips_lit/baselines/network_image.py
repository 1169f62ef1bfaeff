"""What learned baselines share: the image as their networks take it, and their output as `Features`."""

from __future__ import annotations

import math

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.detect.base import best_keypoints
from sips_lit.detect.selection import image_tensor
from sips_lit.types import Features, GreyImage, Keypoints


def network_image(image: GreyImage, multiple: int = 1, smallest: int = 1) -> Tensor:
    """(1, 1, H', W') float32 in [0, 1]: the image, padded to multiples of ``multiple`` and at least ``smallest``.

    The padding repeats the last column and row, at the right and at the bottom, so that coordinates stay what they are
    and no edge appears where the image ends.
    """
    height, width = image.shape
    right, bottom = (max(smallest, math.ceil(size / multiple) * multiple) - size for size in (width, height))
    return F.pad(image_tensor(image) / 255, (0, right, 0, bottom), mode="replicate")


def best_inside(xy: Tensor, score: Tensor, shape: tuple[int, ...], n: int) -> tuple[Keypoints, Tensor]:
    """The at most ``n`` best of the points ``xy`` (N, 2) that are inside an image of ``shape``, and their rows (M,).

    Points in the padding are dropped. The scale of all is 1.
    """
    limit = torch.tensor([shape[1], shape[0]], dtype=xy.dtype) - 0.5
    rows = torch.nonzero(((xy >= -0.5) & (xy <= limit)).all(dim=1))[:, 0].numpy()
    keypoints, best = best_keypoints(xy.numpy()[rows], score.numpy()[rows], np.ones(len(rows)), n)
    return keypoints, torch.from_numpy(rows[best])


def as_features(keypoints: Keypoints, descriptors: Tensor) -> Features:
    """Points with their descriptors (N, D), made unit length."""
    return Features(keypoints, F.normalize(descriptors.float(), dim=1).numpy(), "l2")
