"""SURF descriptors of given points (Bay et al. 2008), computed by mahotas: the descriptor of the SIPs paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.describe.scale_levels import scale_levels
from sips_lit.errors import BadInputError, import_extra
from sips_lit.types import GreyImage, Keypoints, Norm

_SCALE_OF_SIZE = 1.2 / 9  # SURF's filter of 9 px is scale 1.2


class SurfDescriptor:
    """SURF with the orientation that it finds at the point: (N, 64) float32 of length 1 (zero where nothing varies).

    ``size`` is the point's diameter in pixels at scale 1, as OpenCV counts it. Scales are rounded to powers of sqrt(2):
    mahotas describes a point and its enlarged copy alike only where both have the same scale in pixels.
    """

    name: str = "SURF (mahotas)"
    norm: Norm = "l2"

    def __init__(self, size: float = 31.0) -> None:
        """Raises BadInputError where mahotas is missing or ``size`` is not positive."""
        if not size > 0:
            raise BadInputError(
                f"The descriptor's size is {size}; give a diameter in pixels above 0 (the default is 31)."
            )
        import_mahotas()  # a missing package shows at the start, not at the first image
        self.size = size

    def describe(self, image: GreyImage, keypoints: Keypoints) -> NDArray[Any]:
        """(N, 64) float32, one row for each keypoint."""
        descriptors = np.zeros((len(keypoints), 64), np.float32)
        scale = self.size * _SCALE_OF_SIZE
        for level in scale_levels(image, keypoints, shrink=1.0, margin=reach(scale)):
            unused = np.ones((len(level.rows), 2))  # score and sign of the detector: carried along by mahotas, not read
            points = np.column_stack([level.xy[:, ::-1], np.full(len(level.rows), scale), unused])
            descriptors[level.rows] = describe_rows(level.image, points)
        return descriptors


def reach(scale: float) -> int:
    """Pixels between a point of ``scale`` and the border: mahotas drops those nearer than about 15.5 times their scale."""
    return math.ceil(16 * scale) + 2


def describe_rows(image: GreyImage, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """mahotas' descriptors (N, 64) of its rows (y, x, scale, score, sign), which keep their `reach` from the border."""
    descriptors: NDArray[np.float64] = import_mahotas().descriptors(image, rows, descriptor_only=True)
    if len(descriptors) != len(rows):
        raise RuntimeError(f"mahotas described {len(descriptors)} of {len(rows)} points")
    return descriptors


def import_mahotas() -> Any:
    """The module ``mahotas.features.surf``. Raises BadInputError where mahotas is missing."""
    return import_extra("mahotas.features.surf", "surf", "SURF")
