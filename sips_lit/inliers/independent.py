"""Base of the checks that verify each match by itself, whatever the other matches are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from sips_lit.types import DisparityMatcher, FramePair, Inliers, Keypoints, Matches, PreparedCheck


class IndependentCheck(ABC):
    """An `InlierCheck` without preparation: a subclass defines ``protocol`` and ``__call__``, and says what it uses."""

    __slots__ = ()
    independent: ClassVar[bool] = True
    uses_frames: ClassVar[bool] = False
    uses_depth: ClassVar[bool] = False

    @property
    def stereo(self) -> DisparityMatcher | None:
        """None: how depth is found is left to the caller."""
        return None

    @property
    @abstractmethod
    def protocol(self) -> Mapping[str, Any]:
        """The method and its thresholds, for results."""

    @abstractmethod
    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Verifies M matches between the points of both images."""

    def prepare(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedCheck:
        """The check of these points."""
        return lambda matches, repeat=0: self(pair, keypoints0, keypoints1, matches)
