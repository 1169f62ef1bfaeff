"""Match pictures of what was measured, from cached features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sips_lit.evaluate.features import FeatureCache, image_key
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import MethodResult
from sips_lit.report.pair_pictures import PairPicture, draw_pair_pictures
from sips_lit.types import Features, FramePair, GreyImage, InlierCheck


def draw_method_pictures(
    results: Sequence[MethodResult],
    methods: Sequence[Method],
    pairs: PairSet,
    measures: Measures,
    cache_folder: Path | None,
) -> Mapping[str, Sequence[PairPicture]]:
    """The best, the median and the worst pair of each method that was measured, by its key."""
    by_key = {method.key: method for method in methods}
    return {result.key: _draw(result, by_key[result.key], pairs, measures, cache_folder) for result in results}


def _draw(
    result: MethodResult, method: Method, pairs: PairSet, measures: Measures, cache_folder: Path | None
) -> Sequence[PairPicture]:
    detector = method.detector
    cache = FeatureCache(cache_folder, method, measures.points(detector.scores))

    def features_of(image: GreyImage) -> Features:
        return cache(image_key(image), lambda: image).features

    def pair_of(at: int) -> tuple[FramePair, InlierCheck]:
        return pairs.read(at, depth=False), pairs.check(at)

    return draw_pair_pictures(result, pair_of, features_of, measures.n, detector.score_map)
