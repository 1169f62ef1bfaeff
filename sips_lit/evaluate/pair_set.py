"""A pair set: the same pairs for all methods, read once."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import image_key
from sips_lit.evaluate.result import PairTable
from sips_lit.frames.frame_cache import CachedSequence, FrameCache
from sips_lit.frames.source import Source
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.geometry.projection import views
from sips_lit.pairs.choice import ListedPair
from sips_lit.pairs.pose_refinement import RefinedPose, refine_pose, summary, with_pose
from sips_lit.pairs.sampler import read_pair
from sips_lit.progress import progress
from sips_lit.types import FramePair, ImageSequence, InlierCheck, Keypoints, Matches


class PairSet:
    """Pairs with the check of each, named ``key`` in files and ``title`` in tables; ``chosen`` says how they were chosen.

    What is read stays in ``cache`` (of its own, if None is given). ``refine_poses``: true poses are refined on tracks
    through the frames between. Raises BadInputError where there are no pairs, and for data of which a part is missing.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        listed: Sequence[ListedPair],
        default: InlierCheck,
        cache: FrameCache | None = None,
        key: str = "data",
        title: str | None = None,
        chosen: Mapping[str, Any] | None = None,
        refine_poses: bool = False,
    ) -> None:
        damaged = [s.damage for source in sources for s in source.sequences if s.damage]
        if damaged:
            raise BadInputError(
                f"{damaged[0]}: get the file whole, since results on a part of it would pass for its own"
            )
        cache = cache or FrameCache()
        self.key, self.title, self.chosen = key, title or key, dict(chosen or {})
        if not listed:
            raise BadInputError("the pair set has no pairs: check its data and its kind of pairs")
        self.listed = list(listed)
        self.left_out: list[str] = []
        self.sequences = [CachedSequence(s, cache) for source in sources for s in source.sequences]
        self.checks = [source.inliers or default for source in sources for _ in source.sequences]
        self.refine_poses = refine_poses
        self._poses: dict[tuple[int, int, int], RefinedPose | None] = {}
        self._keys: dict[tuple[int, int], str] = {}
        self._sizes: set[tuple[int, ...]] = set()

    def __len__(self) -> int:
        return len(self.listed)

    def check(self, at: int) -> InlierCheck:
        """What says which matches of pair ``at`` are inliers."""
        return self.checks[self.listed[at].sequence]

    def read(self, at: int, depth: bool) -> FramePair:
        """Pair ``at``; with depth maps or stereo partners only if ``depth``, or if its check needs them."""
        pair, refined = self._read(at, depth), self._refined(at) if self.refine_poses else None
        return with_pose(pair, refined)

    def _read(self, at: int, depth: bool) -> FramePair:
        pair, check = self.listed[at], self.check(at)
        sequence = self.sequences[pair.sequence]
        return read_pair(sequence, pair.index0, pair.index1, check.uses_frames, depth or check.uses_depth)

    def _refined(self, at: int) -> RefinedPose | None:
        pair = self.listed[at]
        key = pair.sequence, pair.index0, pair.index1
        if key not in self._poses:
            tracked = read_pair(self.sequences[pair.sequence], pair.index0, pair.index1)
            self._poses[key] = refine_pose(tracked, self.check(at).stereo)
        return self._poses[key]

    def frames(self) -> list[tuple[int, int]]:
        """Each different frame: the position of its sequence, and its index."""
        ends = [(p.sequence, index) for p in self.listed for index in (p.index0, p.index1)]
        return sorted(set(ends))

    def key_of(self, frame: tuple[int, int]) -> str:
        """A hash of the content of a frame."""
        if frame not in self._keys:
            image = self.sequences[frame[0]].frame(frame[1])
            self._keys[frame] = image_key(image)
            self._sizes.add(image.shape)
        return self._keys[frame]

    def table(self) -> PairTable:
        """Names, overlaps and motions of all pairs."""
        columns = np.array([self._apart(pair) for pair in self.listed], np.float64).T
        return PairTable(tuple(map(self._name, self.listed)), *columns)

    def verifiable(self) -> PairSet:
        """The pairs without those whose depth or pose their check misses: they say nothing about any method.

        ``left_out`` names the others. Raises BadInputError where none is left, or has a pose that could be refined as asked.
        """
        bar = progress(range(len(self)), desc="depth", unit="pair")
        complaints = [self._complaint(at) for at in bar]
        if all(complaints):
            raise BadInputError(f"no pair can be verified, as {complaints[0]}")
        verifiable = copy.copy(self)
        verifiable.listed = [pair for pair, why in zip(self.listed, complaints, strict=True) if why is None]
        if self.refine_poses and verifiable._refined(0) is None:
            name = self._name(verifiable.listed[0])
            raise BadInputError(
                f"refine_poses needs poses, cameras and depth, which {name} does not have: set it to false"
            )
        verifiable.left_out = [self._name(pair) for pair, why in zip(self.listed, complaints, strict=True) if why]
        return verifiable

    def _complaint(self, at: int) -> str | None:
        """Why pair ``at`` can't be verified with the depth of its images; None if it can."""
        check = self.check(at)
        if not check.uses_depth:
            return None
        pair, no_index = self._read(at, depth=True), np.zeros(0, np.int64)
        try:
            check(pair, Keypoints.empty(), Keypoints.empty(), Matches(no_index, no_index))
        except BadInputError as error:
            return str(error)
        if not any(view.tells_depth for view in views(pair) or ()):
            return f"{pair.name} has depth maps without any depth in them: choose another source of inliers"
        return None

    def _apart(self, pair: ListedPair) -> tuple[float, ...]:
        sequence = self.sequences[pair.sequence]
        gap = abs(pair.index1 - pair.index0) if sequence.temporal else math.nan
        return pair.overlap, gap, pair.pixels, *_motion(sequence, pair.index0, pair.index1)

    def _name(self, pair: ListedPair) -> str:
        return f"{self.sequences[pair.sequence].name}:{pair.index0}-{pair.index1}"

    @property
    def protocol(self) -> dict[str, Any]:
        """Which data, how its pairs were chosen, and how they are verified."""
        used = sorted({pair.sequence for pair in self.listed})
        checks = {id(self.checks[at]): dict(self.checks[at].protocol) for at in used}
        for frame in self.frames():
            self.key_of(frame)
        return {
            "sequences": [self.sequences[at].name for at in used],
            "image_size": sorted("{1}x{0}".format(*shape) for shape in self._sizes),
            "pairs": len(self.listed),
            **self.chosen,
            "verification": list(checks.values()),
            **({"refined_poses": summary(list(map(self._refined, range(len(self)))))} if self.refine_poses else {}),
            **({"left_out": self.left_out} if self.left_out else {}),
        }


def _motion(sequence: ImageSequence, index0: int, index1: int) -> tuple[float, float]:
    """Rotation (degrees) and distance (metres) between two frames; NaN where poses are not known."""
    pose0, pose1 = sequence.pose(index0), sequence.pose(index1)
    if pose0 is None or pose1 is None:
        return math.nan, math.nan
    T_1_0, same = np.linalg.inv(pose1) @ pose0, np.eye(4)
    return rotation_error(T_1_0, same), translation_error(T_1_0, same)
