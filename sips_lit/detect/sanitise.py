"""Makes legal whatever a detector returns, and counts every change."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.base import ranked
from sips_lit.errors import BadInputError
from sips_lit.types import Features, Keypoints

Points = TypeVar("Points", Keypoints, Features)


@dataclass(frozen=True, slots=True)
class Defects:
    """What was wrong with the points of ``images`` images; the sum of two is that of all their images.

    ``returned`` points = ``invalid`` (position, score, scale or descriptor not finite, or scale not positive)
    + ``outside`` (of the image) + ``duplicates`` (same position and scale, and same descriptor where there is one)
    + ``surplus`` (worse than the n best) + ``kept``. Where fewer are kept than ``asked``, ``missing`` counts the rest.
    ``unsorted`` counts images whose scores did not descend, ``short`` those with fewer points than asked, ``empty``
    those without any.
    """

    images: int = 0
    asked: int = 0
    returned: int = 0
    invalid: int = 0
    outside: int = 0
    duplicates: int = 0
    surplus: int = 0
    kept: int = 0
    missing: int = 0
    unsorted: int = 0
    short: int = 0
    empty: int = 0

    def __add__(self, other: Defects) -> Defects:
        """The counts of both together."""
        return Defects(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(self)))

    def __str__(self) -> str:
        """What was mended, in words; empty if nothing was."""
        reasons = ("invalid", "outside", "duplicates", "surplus")
        dropped = [f"{getattr(self, reason)} {reason}" for reason in reasons if getattr(self, reason)]
        words = [f"dropped {', '.join(dropped)} of {self.returned} points"] if dropped else []
        if self.unsorted:
            words.append(f"sorted the points of {self.unsorted} of {self.images} images")
        return "; ".join(words)


def sanitise(points: Points, image_shape: tuple[int, ...], n: int) -> tuple[Points, Defects]:
    """The at most ``n`` best legal points of an image of shape (H, W, …), sorted, and what was done to get there.

    The area of the pixels counts as inside: -0.5 <= x <= W - 0.5, and y alike. Order: score descending, ties by row,
    then column. Of duplicates the best is kept. Features at one place with different descriptors (as SIFT gives where
    there are several orientations) are no duplicates. Raises BadInputError where the arrays do not belong together.
    """
    keypoints = points.keypoints if isinstance(points, Features) else points
    descriptors = points.descriptors if isinstance(points, Features) else np.zeros((len(keypoints), 0), np.uint8)
    _refuse_mismatch(keypoints, descriptors)
    n = max(n, 0)

    valid = _valid(keypoints, descriptors)
    half = np.float32(0.5)
    within = (keypoints.xy >= -half) & (keypoints.xy <= np.array(image_shape[1::-1], np.float32) - half)
    inside = valid & within.all(axis=1)
    legal = np.flatnonzero(inside)
    rows = legal[ranked(keypoints.xy[legal], keypoints.score[legal], len(legal))]
    rows = rows[_first_of_each(keypoints, descriptors, rows)]

    kept = rows[:n]
    count = {"images": 1, "asked": n, "returned": len(keypoints), "kept": len(kept), "missing": n - len(kept)}
    defects = Defects(
        **count,
        invalid=int((~valid).sum()),
        outside=int((valid & ~inside).sum()),
        duplicates=len(legal) - len(rows),
        surplus=len(rows) - len(kept),
        unsorted=int((np.diff(keypoints.score[valid]) > 0).any()),
        short=int(len(kept) < n),
        empty=int(len(kept) == 0 < n),
    )
    cleaned = replace(keypoints[kept], depth=None)
    if isinstance(points, Features):
        return Features(cleaned, descriptors[kept], points.norm), defects
    return cleaned, defects


def _refuse_mismatch(keypoints: Keypoints, descriptors: NDArray[np.generic]) -> None:
    shapes = keypoints.xy.shape, keypoints.score.shape, keypoints.scale.shape, descriptors.shape
    count = len(keypoints)
    if shapes[:3] != ((count, 2), (count,), (count,)) or descriptors.ndim != 2 or len(descriptors) != count:
        raise BadInputError(
            f"the detector returned positions, scores, scales and descriptors of shapes {', '.join(map(str, shapes))}: "
            "they must be (N, 2), (N,), (N,) and (N, D)"
        )
    if keypoints.covariance is not None and keypoints.covariance.shape != (count, 2, 2):
        raise BadInputError(
            f"the detector returned covariances of shape {keypoints.covariance.shape} for {count} points: give (N, 2, 2)"
        )


def _valid(keypoints: Keypoints, descriptors: NDArray[np.generic]) -> NDArray[np.bool_]:
    scale_is_legal = np.isfinite(keypoints.scale) & (keypoints.scale > 0)
    finite = np.isfinite(keypoints.xy).all(axis=1) & np.isfinite(keypoints.score) & scale_is_legal
    if keypoints.covariance is not None:
        finite &= np.isfinite(keypoints.covariance).all(axis=(1, 2))
    if np.issubdtype(descriptors.dtype, np.floating):
        finite &= np.isfinite(descriptors.astype(np.float64)).all(axis=1)
    return finite


def _first_of_each(
    keypoints: Keypoints, descriptors: NDArray[np.generic], rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Indices into ``rows``, ascending: the first of each group of equal points."""
    place = np.column_stack([keypoints.xy[rows], keypoints.scale[rows]]).astype(np.float64) + 0.0  # -0.0 equals 0.0
    first: dict[tuple[bytes, bytes], int] = {}
    for index, row in enumerate(rows):
        first.setdefault((place[index].tobytes(), descriptors[row].tobytes()), index)
    return np.array(list(first.values()), np.int64)
