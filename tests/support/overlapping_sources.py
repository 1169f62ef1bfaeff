"""Sources of sequences in which every frame sees all later ones, and the pairs of them."""

import dataclasses

import numpy as np
from overlap_rows import all_overlap
from textured_scenes import flight

from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.pairs.sampler import SourcePair, SourceSampler
from sips_lit.types import FramePair


def sources(weights: tuple[float, ...] = (1.0, 3.0)) -> list[Source]:
    """The first source has two sequences, the others one."""
    made = [Source([flight(5, name="a"), flight(4, seed=1, name="b")], weights[0], name="first")]
    made += [Source([flight(6, seed=2 + i, name=f"c{i}")], w, HomographyInliers()) for i, w in enumerate(weights[1:])]
    return made


def sampler_of(data: list[Source], seed: int = 3) -> SourceSampler:
    return SourceSampler(data, [all_overlap(len(s)) for source in data for s in source.sequences], 0.5, seed)


def assert_same(a: SourcePair, b: SourcePair) -> None:
    assert a.source == b.source
    for field in dataclasses.fields(FramePair):
        one, other = getattr(a.pair, field.name), getattr(b.pair, field.name)
        if field.name == "frames":
            assert len(one) == len(other)
            assert all(np.array_equal(x, y) for x, y in zip(one, other, strict=True))
        else:
            np.testing.assert_array_equal(one, other)
