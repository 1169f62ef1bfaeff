"""The choice of a detector's own descriptor."""

from __future__ import annotations


def own() -> None:
    """No descriptor: the detector describes its points itself."""
    return None
