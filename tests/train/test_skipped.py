"""Pairs that can't be read: others take their place, the same for any number of workers and after an interruption."""

import numpy as np
import pytest
from overlap_rows import all_overlap
from textured_scenes import ArraySequence, flight
from train_stream import Learner, after_interruption, assert_same, run

from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.source import Source
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import SourceSampler
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import PackedPairs, SkippedItems, TrainingPairs
from sips_lit.train.loader import LabelledPair, OneStepAhead

LENGTH = 14
WHY = "clip/002.png is damaged: replace or remove it"


class Damaged(ArraySequence):
    """A frame can't be read, though the overlap index does not know."""

    bad = 2

    def frame(self, index):
        if index == self.bad:
            raise BadInputError(f"clip/{index:03d}.png is damaged: replace or remove it")
        return super().frame(index)


def training_pairs(sequence: ArraySequence, length: int = LENGTH) -> TrainingPairs:
    sources = [Source([sequence])]
    sampler = SourceSampler(sources, [all_overlap(len(sequence))], 0.5, seed=1)
    return TrainingPairs(sources, sampler, KltInliers(), Augmentation(), length)


def loader(learner: Learner, loading: int = 0, sequence: ArraySequence | None = None, length: int = LENGTH):
    pairs = training_pairs(sequence or Damaged(flight(8, size=(80, 64)).frames, "clip"), length)
    return OneStepAhead(PackedPairs(pairs), learner.select, RootSift(), [KltInliers()], loading, 1)


@pytest.fixture(scope="module")
def expected() -> list[LabelledPair]:
    learner = Learner()
    return run(loader(learner), learner)


def test_the_first_readable_draw_takes_the_place(expected):
    sampler = training_pairs(Damaged(flight(8).frames, "clip")).sampler
    skipped = 0
    for index, pair in enumerate(expected):
        attempt = 0
        while True:
            choice = sampler.draw(attempt, index)[1]
            low, high = sorted((choice.index0, choice.index1))
            if not low <= 2 <= high:
                break
            attempt += 1
        skipped += attempt
        assert pair.name == f"clip:{choice.index0}-{choice.index1}"
        assert pair.skipped == skipped
    assert 3 < skipped < LENGTH


@pytest.mark.parametrize("loading", [1, 2])
def test_whatever_the_workers(loading, expected, recwarn):
    learner = Learner()
    taken = run(loader(learner, loading), learner)
    assert len(taken) == LENGTH
    for pair, other in zip(taken, expected, strict=True):
        assert_same(pair, other)
        assert pair.skipped == other.skipped
    warned = [str(warning.message) for warning in recwarn if warning.category is InputWarning]
    assert warned == [f"a training pair is left out, and others may be: {WHY}"]


@pytest.mark.parametrize("stop", [1, 5, LENGTH - 1])
@pytest.mark.parametrize("loading", [0, 2])
def test_after_an_interruption(stop, loading, expected, tmp_path):
    rest, second, _ = after_interruption(lambda learner: loader(learner, loading), stop, tmp_path)
    assert len(rest) == LENGTH - stop
    for pair, other in zip(rest, expected[stop:], strict=True):
        assert_same(pair, other)
        assert pair.skipped == other.skipped
    assert second.skipped.first == WHY


def test_readable_data_is_drawn_as_ever():
    learner, frames = Learner(), flight(8, size=(80, 64)).frames
    pairs = training_pairs(ArraySequence(frames, "clip"))
    plain = run(loader(learner, sequence=ArraySequence(frames, "clip")), learner)
    for index, pair in enumerate(plain):
        choice = pairs.sampler.draw(0, index)[1]
        assert pair.name == f"clip:{choice.index0}-{choice.index1}"
        assert pair.skipped == 0


@pytest.mark.parametrize("loading", [0, 1])
def test_nothing_readable(loading):
    class Gone(ArraySequence):
        def frame(self, index):
            raise BadInputError(f"{index}.png is gone")

    learner = Learner()
    with pytest.raises(BadInputError, match=r"20 training pairs in a row can't be read; the first: \d\.png is gone"):
        run(loader(learner, loading, Gone(flight(4).frames, "clip")), learner)


def test_too_many_that_cannot_be_read():
    learner = Learner()
    middle = Damaged(flight(5, size=(80, 64)).frames, "clip")  # most pairs of five frames reach across the third
    with pytest.raises(
        BadInputError, match=r"\d\d of the first \d\d training pairs can't be read; the first: clip/002"
    ):
        run(loader(learner, sequence=middle, length=100), learner)


@pytest.mark.parametrize(("pairs", "enough"), [(50, True), (49, False), (500, True)])
def test_half_of_the_pairs_is_enough(pairs, enough):
    skipped = SkippedItems()
    skipped.add(["a is damaged"] * 20, 1)
    skipped.add(["b is damaged"] * 29, 2)  # so few pairs do not tell
    if enough:
        skipped.add(["c is damaged"], pairs)
        assert str(skipped) == "50 training pairs were left out; the first: a is damaged"
    else:
        with pytest.raises(BadInputError, match="50 of the first 99 training pairs can't be read; the first: a is"):
            skipped.add(["c is damaged"], pairs)


def test_right_images_and_depth_count_as_parts_of_a_pair():
    class NoRight(ArraySequence):
        """The right image of frame 3 is damaged."""

        def camera(self, index):
            return object()

        def right(self, index):
            if index == 3:
                raise BadInputError("right/3.png is damaged")
            return self.frames[index]

    class Stereo(KltInliers):
        uses_frames, uses_depth = False, True

    sequence = NoRight(flight(8).frames, "clip")
    pairs = training_pairs(sequence, 40)
    pairs.augmentation, pairs.default = None, Stereo()
    items = [pairs[index] for index in range(40)]
    assert {why for item in items for why in item.skipped} == {"right/3.png is damaged"}
    assert all(3 not in (item.pair.index0, item.pair.index1) for item in items)
    np.testing.assert_array_equal(items[0].pair.image0, sequence.frames[items[0].pair.index0])


def test_an_index_that_is_gone_costs_the_pairs_of_its_sequence(tmp_path):
    """As where somebody removes a video's files while a training runs."""
    films = [flight(8, seed=seed, size=(80, 64), name=name) for seed, name in enumerate(("gone", "there"))]
    sources = [Source(films)]
    stored = build_indexes(films, tmp_path, OverlapParameters())
    pairs = TrainingPairs(sources, SourceSampler(sources, stored, 0.2, seed=1), KltInliers(), None, 30)
    stored[0].path.unlink()
    drawn = [pairs[index] for index in range(30)]
    assert all(item.pair.name.startswith("there:") for item in drawn)
    reasons = [reason for item in drawn for reason in item.skipped]
    assert reasons
    assert all("is gone or damaged" in reason for reason in reasons)
