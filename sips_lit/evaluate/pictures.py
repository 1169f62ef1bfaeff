"""Match pictures of the best, the median and the worst pair of an evaluation."""

from __future__ import annotations

from pathlib import Path

import cv2

from sips_lit.detect.detector import SipsDetector
from sips_lit.evaluate.evaluation import Evaluation
from sips_lit.evaluate.features import extract
from sips_lit.evaluate.pairs import PairSet
from sips_lit.inliers.verification import verify
from sips_lit.render.matches import draw_matches
from sips_lit.types import Descriptor, Detector


def write_match_pictures(
    folder: Path,
    key: str,
    evaluation: Evaluation,
    pairs: PairSet,
    detector: Detector,
    descriptor: Descriptor | None,
    n: int,
) -> list[Path]:
    """Draws three pairs, chosen by n_k, with their ``n`` best points (and score maps of a SIPs detector)."""
    folder.mkdir(parents=True, exist_ok=True)
    needed = [row.n_k if row.n_k is not None else evaluation.succinctness.n_max + 1 for row in evaluation.rows]
    order = sorted(range(len(needed)), key=lambda index: needed[index])
    written = []
    for label, index in (("best", order[0]), ("median", order[len(order) // 2]), ("worst", order[-1])):
        item = pairs.pairs[index]
        pair, check = item.pair, pairs.checks[item.source]
        features0, features1 = (extract(detector, descriptor, image, n) for image in (pair.image0, pair.image1))
        matches, inliers = verify(pair, features0, features1, check).at(n)
        maps = [
            detector.score_map(i) if isinstance(detector, SipsDetector) else None for i in (pair.image0, pair.image1)
        ]
        picture = draw_matches(
            pair.image0, pair.image1, features0.keypoints, features1.keypoints, matches, inliers, *maps
        )
        path = folder / f"{key}_{label}.png"
        cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        written.append(path)
    return written
