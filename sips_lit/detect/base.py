"""What a detector is unless it says otherwise: points in the order of their scores, no descriptor, no score map."""

from __future__ import annotations

from sips_lit.types import Features, FloatArray, GreyImage, ScoreKind


class BaseDetector:
    """Base of detectors: a subclass sets ``name`` and defines ``detect`` (see `sips_lit.types.Detector`)."""

    name: str
    describes: bool = False
    scores: ScoreKind = "order"

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """Raises TypeError: there is no descriptor."""
        raise TypeError(f"{self.name} has no descriptor of its own: detect points, then describe them")

    def score_map(self, image: GreyImage) -> FloatArray | None:
        """None: there is no map."""
        return None
