"""From the points of OpenCV's detectors to `Keypoints`: one order and one cut for all baselines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def positions(points: Sequence[Any]) -> NDArray[np.float64]:
    """(N, 2): where ``cv2.KeyPoint`` objects say they are."""
    return np.array([point.pt for point in points], np.float64).reshape(-1, 2)


def attribute(points: Sequence[Any], name: str) -> NDArray[np.float64]:
    """(N,): one attribute (``response``, ``size``, ``octave``, …) of ``cv2.KeyPoint`` objects."""
    return np.array([getattr(point, name) for point in points], np.float64)
