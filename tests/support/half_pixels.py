"""Where a detector's points lie in images whose change is known to a hundredth of a pixel: traces of half pixels.

Each probe gives (dx, dy): how far the points of a changed image, taken back, lie from the points of the image itself, in its
pixels. A detector whose points lie b px too far right has -2 b when turned, -b / 2 in an image twice as large. A learned
detector may prefer one side of what it looks at, as ALIKED does by 2 px: turning shows that too, zooming only the part that
does not grow with the image (of n16 0.4 px).
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pytest

from sips_lit.types import Detector, FloatArray, GreyImage

_FAR = 6.0  # pixels: what is farther is another point
_PEAK = 4.0  # times the mean density that differences have where points are found again
_WIDTH = 0.6  # pixels: of the kernel


def photographs(width: int = 256, height: int = 192) -> list[GreyImage]:
    """Parts of three of scikit-image's photographs: real texture, aligned with no pixels."""
    data = pytest.importorskip("skimage.data", reason="scikit-image has the photographs")
    corners = [(data.camera(), 110, 90), (data.coins(), 60, 60), (data.brick(), 0, 0)]
    return [np.ascontiguousarray(image[y : y + height, x : x + width]) for image, x, y in corners]


def turned(detector: Detector, images: Sequence[GreyImage], n: int = 150) -> FloatArray:
    """The images turned by 180 degrees: x -> W - 1 - x, y -> H - 1 - y."""
    last = np.array(images[0].shape[::-1]) - 1
    return _offset(detector, images, lambda image: image[::-1, ::-1], lambda xy: last - xy, n)


def shifted(detector: Detector, images: Sequence[GreyImage], dx: int, dy: int, n: int = 150) -> FloatArray:
    """The images without their first ``dx`` columns and ``dy`` rows."""
    return _offset(detector, images, lambda image: image[dy:, dx:], lambda xy: xy + np.array([dx, dy]), n)


def doubled(detector: Detector, images: Sequence[GreyImage], n: int = 150) -> FloatArray:
    """The images at twice their size, by cubic interpolation about the edges of pixels: x -> (x + 0.5) * 2 - 0.5."""
    return _offset(detector, images, _twice, lambda xy: (xy + 0.5) / 2 - 0.5, n)


def _twice(image: GreyImage) -> GreyImage:
    return cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)


def _offset(
    detector: Detector,
    images: Sequence[GreyImage],
    change: Callable[[GreyImage], GreyImage],
    back: Callable[[FloatArray], FloatArray],
    n: int,
) -> FloatArray:
    """Where the differences of all points to all near ones are densest: what coincides by chance is spread evenly."""
    parts = []
    for image in images:
        here = detector.detect(image, n).xy
        there = back(detector.detect(np.ascontiguousarray(change(image)), n).xy.astype(float))
        apart = (there[:, None] - here).reshape(-1, 2)
        parts.append(apart[np.abs(apart).max(axis=1) < _FAR])
    apart = np.concatenate(parts)
    grid = np.stack(np.meshgrid(*[np.arange(-4, 4.1, 0.25)] * 2), axis=-1).reshape(-1, 2)
    density = np.array([_weights(apart, place).sum() for place in grid])
    assert density.max() > _PEAK * density.mean(), "too few points are found again"
    centre: FloatArray = grid[density.argmax()]
    for _ in range(50):  # mean shift
        centre = np.average(apart, axis=0, weights=_weights(apart, centre))
    return centre


def _weights(apart: FloatArray, centre: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-((apart - centre) ** 2).sum(axis=1) / (2 * _WIDTH**2)))
