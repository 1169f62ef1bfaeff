"""Repeatability and matching score: how many points are found again, and how many of them are matched rightly.

Both are fractions of the points in the common view, as in Mikolajczyk and Schmid ("A performance evaluation of local
descriptors", PAMI 2005; "Scale and affine invariant interest point detectors", IJCV 2004) and, with points instead of
regions, in HPatches (Balntas et al., CVPR 2017) and SuperPoint (DeTone et al., 2018):

    repeatability  = correspondences / min(N0, N1)        matching score = correct matches / min(N0, N1)

N0 are the points of image 0 that image 1 sees, N1 those of image 1 that image 0 sees. Two points may correspond if each,
moved to the other image by the true geometry, is within ``threshold`` pixels of the other. They are paired one to one:
mutual nearest points first, then those among the rest, and so on, so no point is counted twice. (SuperPoint counts every
point that has some point near it, which many points in one place inflate.) A match is correct if its points are that near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.projection import View, apply_homography, inside, posed_views, transfer_to_view
from sips_lit.types import DisparityMatcher, FloatArray, FramePair, Keypoints, Matches


@dataclass(frozen=True, slots=True)
class MovedPoints:
    """The N points of one image as the other sees them.

    ``xy`` (N, 2): their places in the other image, NaN where unknown; ``known`` (N,): whether it is known if the other
    image sees them; ``visible`` (N,): that it does.
    """

    xy: NDArray[np.float64]
    known: NDArray[np.bool_]
    visible: NDArray[np.bool_]

    def best(self, n: int) -> MovedPoints:
        """The first ``n``."""
        return MovedPoints(self.xy[:n], self.known[:n], self.visible[:n])


@dataclass(frozen=True, slots=True)
class Repeated:
    """Repeatability and matching score of a pair; NaN where the truth is known of no point."""

    repeatability: float
    matching_score: float


def move_points(
    pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, stereo: DisparityMatcher, occlusion: float = 0.05
) -> tuple[MovedPoints, MovedPoints] | None:
    """The points of a pair moved to the other image; None where neither homography nor depth is known.

    Depth is what the keypoints bring; else that of the maps or, without them, by ``stereo``. With maps a point is hidden
    where the other's surface is nearer by more than ``occlusion`` (relative). Where only one image has depth, the points of
    the other can't be moved and all count as visible.
    """
    if pair.homography is not None:
        H = pair.homography
        forward = _by_homography(H, keypoints0.xy, pair.image1.shape)
        return forward, _by_homography(np.linalg.inv(H), keypoints1.xy, pair.image0.shape)
    posed = posed_views(pair)
    if posed is None:
        return None
    view0, view1, T_1_0 = posed
    forward = _by_depth(keypoints0, view0, view1, T_1_0, stereo, occlusion)
    return forward, _by_depth(keypoints1, view1, view0, np.linalg.inv(T_1_0), stereo, occlusion)


def repeated(
    xy0: FloatArray,
    xy1: FloatArray,
    moved0: MovedPoints,
    moved1: MovedPoints,
    matches: Matches,
    threshold: float = 3.0,
) -> Repeated:
    """Both measures of points (N0, 2) and (N1, 2), from where they move to and from how they were matched.

    Zero where an image has no point that the other sees; NaN where there are points but nothing is known of them.
    """
    if (len(xy0) and not moved0.known.any()) or (len(xy1) and not moved1.known.any()):
        return Repeated(float("nan"), float("nan"))
    seen = min(int(moved0.visible.sum()), int(moved1.visible.sum()))
    if not seen:
        return Repeated(0.0, 0.0)
    distance = _distances(xy0, xy1, moved0, moved1)
    corresponding = _pair_up(distance, threshold)
    correct = int((distance[matches.index0, matches.index1] <= threshold).sum())
    return Repeated(corresponding / seen, correct / seen)


def _pair_up(distance: NDArray[np.float64], threshold: float) -> int:
    """Pairs when rows and columns of (N0, N1) are paired one to one, the nearest first, up to ``threshold``."""
    rows, columns = np.nonzero(distance <= threshold)
    order = np.argsort(distance[rows, columns], kind="stable")
    taken0, taken1 = set[int](), set[int]()
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if row not in taken0 and column not in taken1:
            taken0.add(row)
            taken1.add(column)
    return len(taken0)


def _distances(xy0: FloatArray, xy1: FloatArray, moved0: MovedPoints, moved1: MovedPoints) -> NDArray[np.float64]:
    """(N0, N1) larger of the distances in both images, or the one that is known; inf where a point is not visible."""
    in1 = np.linalg.norm(moved0.xy[:, None] - xy1[None], axis=2)
    in0 = np.linalg.norm(xy0[:, None] - moved1.xy[None], axis=2)
    distance = np.fmax(in1, in0)
    distance[~(moved0.visible[:, None] & moved1.visible[None])] = np.inf
    return np.where(np.isnan(distance), np.inf, distance)


def _by_homography(H: FloatArray, xy: FloatArray, shape: tuple[int, ...]) -> MovedPoints:
    moved = apply_homography(H, xy)
    return MovedPoints(moved, np.ones(len(xy), np.bool_), inside(moved, (shape[1], shape[0])))


def _by_depth(
    keypoints: Keypoints,
    here: View,
    there: View,
    T_there_here: FloatArray,
    stereo: DisparityMatcher,
    occlusion: float,
) -> MovedPoints:
    if not here.has_depth:
        everything = np.ones(len(keypoints), np.bool_)
        return MovedPoints(np.full((len(keypoints), 2), np.nan), everything, everything)
    own = here.depth_of(keypoints, stereo)
    moved, visible = transfer_to_view(keypoints.xy, own, here, there, T_there_here, occlusion)
    return MovedPoints(moved, np.isfinite(own), visible)
