"""Succinct interest points: the fewest points that still give k inlier correspondences."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sips_lit.detect.detector import SipsDetector
    from sips_lit.types import Keypoints

__all__ = ["Keypoints", "SipsDetector"]


def __getattr__(name: str) -> Any:
    """Loads the public names when they are used: torch takes seconds, and the commands set it up before."""
    if name == "SipsDetector":
        from sips_lit.detect.detector import SipsDetector

        return SipsDetector
    if name == "Keypoints":
        from sips_lit.types import Keypoints

        return Keypoints
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
