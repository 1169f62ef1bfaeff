"""Match pictures of the best, the median and the worst pair of a method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sips_lit.evaluate.result import MethodResult
from sips_lit.match.mutual_nearest import distances, mutual_nearest
from sips_lit.render.canvas import Picture
from sips_lit.render.matches import draw_matches
from sips_lit.report.summary import main_k, median_needed
from sips_lit.types import Features, FloatArray, FramePair, GreyImage, InlierCheck


@dataclass(frozen=True, slots=True)
class PairPicture:
    """A picture of one pair: ``label`` is best, median or worst; ``image`` RGB uint8 (H, W, 3), or the file it is in."""

    label: str
    image: Picture | Path
    caption: str


def draw_pair_pictures(
    result: MethodResult,
    pair_of: Callable[[int], tuple[FramePair, InlierCheck]],
    features_of: Callable[[GreyImage], Features],
    n: int = 50,
    score_map: Callable[[GreyImage], FloatArray | None] = lambda image: None,
) -> list[PairPicture]:
    """Draws the pairs that `choose_pairs` names with their ``n`` best points, and their score maps if there are any.

    ``pair_of`` gives the pair of each row of ``result.pairs`` and its check.
    """
    k = main_k(result)
    needed = median_needed(result, k)
    pictures = []
    for label, index in choose_pairs(needed).items():
        pair, check = pair_of(index)
        how_many = f"n_{k} = {needed[index]:g}" if np.isfinite(needed[index]) else f"never {k} inliers"
        caption = f"{result.pairs.name[index]}: {how_many}; drawn with {n} points"
        pictures.append(PairPicture(label, draw_pair(pair, check, features_of, n, score_map), caption))
    return pictures


def choose_pairs(needed: FloatArray) -> dict[str, int]:
    """Index of the best, median and worst of P pairs by n_k (P,); of fewer than three pairs, each only once."""
    order = [int(index) for index in np.argsort(needed, kind="stable")]
    if not order:
        return {}
    chosen = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    if len(order) < 3:
        del chosen["median"]
    return chosen if len(order) > 1 else {"best": order[0]}


def draw_pair(
    pair: FramePair,
    check: InlierCheck,
    features_of: Callable[[GreyImage], Features],
    n: int,
    score_map: Callable[[GreyImage], FloatArray | None] = lambda image: None,
) -> Picture:
    """The matches between the ``n`` best features of both images, and how they fared."""
    features0, features1 = features_of(pair.image0).best(n), features_of(pair.image1).best(n)
    matches = mutual_nearest(distances(features0, features1))
    inliers = check(pair, features0.keypoints, features1.keypoints, matches)
    maps = score_map(pair.image0), score_map(pair.image1)
    return draw_matches(pair.image0, pair.image1, features0.keypoints, features1.keypoints, matches, inliers, *maps)
