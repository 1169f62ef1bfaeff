"""What the baselines without a descriptor of their own share."""

from __future__ import annotations

from sips_lit.types import Features, GreyImage


class PointsOnly:
    """A detector that leaves the description of its points to others."""

    name: str
    describes: bool = False

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """Raises TypeError: there is no descriptor."""
        raise TypeError(f"{self.name} has no descriptor of its own: detect, then describe the points.")
