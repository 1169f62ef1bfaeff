"""SURF: maxima of box-filtered Hessians, with its own descriptor (Bay et al. 2008), computed by mahotas."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.describe.surf import describe_rows, import_mahotas, reach
from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.types import Features, FloatArray, GreyImage, Keypoints

_OCTAVES = 2
_MARGIN = 24 * 4 ** (
    _OCTAVES - 1
)  # pixels without points in mahotas: 24 in the first octave, four times that in the next
_LOBE = 0.4  # scale of a lobe of one pixel: the filter is three lobes wide, and 9 px are scale 1.2
_SCALE_OF_ONE = 2.5  # what SURF gives a Gaussian blob whose scale is 1 for our SIFT


class SurfDetector(BaseDetector):
    """mahotas' SURF with six filters an octave, on every pixel in the first octave.

    There are two octaves (blobs up to a sigma of about 12 px), as many as mahotas finds points of in a 640 x 480 image.
    Images are padded by repeating their edges, so that points are found and described up to the border.
    A point's scale is that of a blob of its size, in the same unit as for SIFT, and at least 1.
    """

    name: str = "SURF (mahotas)"
    describes: bool = True

    def __init__(self, threshold: float = 0.1) -> None:
        """Find blobs with a Hessian above ``threshold``. Raises BadInputError where mahotas is missing."""
        import_mahotas()  # a missing package shows at the start, not at the first image
        self.threshold = threshold

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        return self._points(image, n)[0]

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 64) of length 1 (zero where nothing varies)."""
        keypoints, points = self._points(image, n)
        margin = reach(points[:, 2].max(initial=0))
        points[:, :2] += margin
        described = describe_rows(np.pad(image, margin, mode="edge"), points)
        return Features(keypoints, described.astype(np.float32), "l2")

    def _points(self, image: GreyImage, n: int) -> tuple[Keypoints, NDArray[np.float64]]:
        """The points, and mahotas' rows (y, x, scale, score, sign) of them, mended."""
        found = self._mended(np.pad(image, _MARGIN, mode="edge"))
        found[:, :2] -= _MARGIN
        found = found[((found[:, :2] >= -0.5) & (found[:, :2] < np.array(image.shape) - 0.5)).all(axis=1)]
        scale = np.maximum(1, found[:, 2] / _SCALE_OF_ONE)
        keypoints, best = best_keypoints(found[:, 1::-1], found[:, 3], scale, n)
        return keypoints, found[best]

    def _mended(self, image: GreyImage) -> NDArray[np.float64]:
        """mahotas' points with the step from the sample to the peak of the quadratic put right.

        mahotas 1.4 takes that step, in position and in scale, in the opposite direction: on Gaussian blobs its points are
        twice as far from the centre as the samples they come from, and the reversed ones within a few hundredths of a pixel.
        """
        surf = import_mahotas()
        integral = surf.integral(image)
        parts: list[NDArray[np.float64]] = []
        known: set[bytes] = set()
        for octave in range(_OCTAVES):  # mahotas does not say which octave a point is of: ask for one more
            found = surf.interest_points(integral, nr_octaves=octave + 1, threshold=self.threshold, is_integral=True)
            found = found.reshape(-1, 5)
            points = found[[row.tobytes() not in known for row in found]]
            known = {row.tobytes() for row in found}
            points[:, :2] = _other_side(points[:, :2] / 2**octave) * 2**octave
            step = 2.0 ** (
                octave + 1
            )  # between the lobes of an octave's filters, the first of which has step + 1 pixels
            points[:, 2] = _LOBE * (_other_side((points[:, 2] / _LOBE - 1) / step) * step + 1)
            parts.append(points)
        return np.concatenate(parts)


def _other_side(values: FloatArray) -> FloatArray:
    """Whole numbers plus a remainder of at most a half, with the remainder taken the other way."""
    mirrored: FloatArray = 2 * np.rint(values) - values
    return mirrored
