"""Match pictures of the best, the median and the worst pair of a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sips_lit.evaluate.features import FeatureCache, image_key
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import MethodResult
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
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


def draw_method_pictures(
    results: Sequence[MethodResult],
    methods: Sequence[Method],
    pairs: PairSet,
    measures: Measures,
    cache_folder: Path | None,
) -> dict[str, list[PairPicture]]:
    """The pictures of each method that was measured, by its key, from cached features."""

    def pair_of(at: int) -> tuple[FramePair, InlierCheck]:
        return pairs.read(at, depth=False), pairs.check(at)

    by_key = {method.key: method for method in methods}
    pictures = {}
    for result in results:
        method = by_key[result.key]
        cache = FeatureCache(cache_folder, method, measures.points(method.detector.scores))
        features_of = partial(_cached_features, cache)
        pictures[result.key] = draw_pair_pictures(result, pair_of, features_of, measures.n, method.detector.score_map)
    return pictures


def _cached_features(cache: FeatureCache, image: GreyImage) -> Features:
    return cache(image_key(image), lambda: image).features


def draw_pair_pictures(
    result: MethodResult,
    pair_of: Callable[[int], tuple[FramePair, InlierCheck]],
    features_of: Callable[[GreyImage], Features],
    n: int = 50,
    score_map: Callable[[GreyImage], FloatArray | None] = lambda image: None,
) -> list[PairPicture]:
    """The pairs that `choose_pairs` names: matches of their ``n`` best points, and their score maps if there are any.

    ``pair_of`` gives the pair of each row of ``result.pairs`` and its check.
    """
    k = main_k(result)
    needed = median_needed(result, k)
    pictures = []
    for label, index in choose_pairs(needed).items():
        pair, check = pair_of(index)
        features0, features1 = features_of(pair.image0).best(n), features_of(pair.image1).best(n)
        keypoints = features0.keypoints, features1.keypoints
        matches = mutual_nearest(distances(features0, features1))
        maps = score_map(pair.image0), score_map(pair.image1)
        drawn = draw_matches(pair.image0, pair.image1, *keypoints, matches, check(pair, *keypoints, matches), *maps)
        how_many = f"n_{k} = {needed[index]:g}" if np.isfinite(needed[index]) else f"never {k} inliers"
        pictures.append(PairPicture(label, drawn, f"{result.pairs.name[index]}: {how_many}; drawn with {n} points"))
    return pictures


def choose_pairs(needed: FloatArray) -> dict[str, int]:
    """Index of the best, median and worst of P pairs by n_k (P,); of fewer than three pairs, each only once."""
    order = np.argsort(needed, kind="stable").tolist()
    if len(order) < 3:
        return dict(zip(("best", "worst"), order, strict=False))
    return {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
