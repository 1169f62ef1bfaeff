"""One detector on one pair set, in one call."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import MethodResult
from sips_lit.evaluate.runner import evaluate_pair_set
from sips_lit.files import safe_name
from sips_lit.frames.source import Source, as_sources
from sips_lit.pairs.choice import choose_pairs
from sips_lit.types import Descriptor, Detector, ImageSequence, InlierCheck


def evaluate_detector(
    detector: Detector,
    data: Sequence[ImageSequence] | Sequence[Source],
    inliers: InlierCheck,
    descriptor: Descriptor | None = None,
    *,
    pairs: int = 100,
    overlap: float = 0.5,
    seed: int = 0,
    measures: Measures | None = None,
    index_folder: str | Path | None = None,
    workers: int = 2,
) -> MethodResult:
    """What ``sips-evaluate`` measures, of ``detector`` with ``descriptor`` (None: its own) on random pairs of ``data``.

    ``inliers`` verifies the matches; ``measures`` says what is measured; ``index_folder`` keeps the overlap of the frames
    for the next call. Raises BadInputError for what the detector, the descriptor or the check cannot do, and for data
    without pairs of this ``overlap``.
    """
    sources, measures = as_sources(data), measures or Measures(seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        listed = choose_pairs(sources, index_folder or folder, "random", pairs, overlap, seed, workers=workers)
    chosen = {"kind": "random", "overlap": overlap, "seed": seed}
    pair_set = PairSet(sources, listed, inliers, chosen=chosen).verifiable()
    name = detector.name if descriptor is None else f"{detector.name} + {descriptor.name}"
    method = Method(safe_name(name).lower(), name, detector, descriptor, {})
    result = evaluate_pair_set([method], pair_set, measures, None, workers)
    if not result.detectors:
        raise BadInputError(result.skipped[method.key])
    return result.detectors[0]
