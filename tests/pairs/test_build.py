import threading
import time

import numpy as np
import pytest
from textured_scenes import ArraySequence, film

from sips_lit.errors import BadInputError
from sips_lit.frames.views import FrameRange, frame_ranges
from sips_lit.pairs.build import (
    build_indexes,
    measuring_threads,
    require_readable,
    unreadable_frames,
)
from sips_lit.pairs.index_file import index_path, load_index
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap

PARAMETERS = OverlapParameters()


class Damaged(ArraySequence):
    """Its frames ``bad`` can't be read."""

    bad: tuple[int, ...] = (3,)

    def frame(self, index):
        if index in self.bad:
            raise BadInputError(f"frame {index} of {self.name} cannot be read")
        return super().frame(index)


def scenes() -> list[ArraySequence]:
    return [film(5, seed=seed, name=f"flight{seed}") for seed in range(3)]


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_in_the_order_of_the_sequences_whatever_the_workers(tmp_path, workers):
    sequences = scenes()
    built = build_indexes(sequences, tmp_path, PARAMETERS, workers)
    for sequence, index in zip(sequences, built, strict=True):
        expected = measure_overlap(sequence, PARAMETERS)
        np.testing.assert_array_equal(index.read().survivors, expected.survivors)
        np.testing.assert_array_equal(index.read().points, expected.points)


def test_a_second_call_reads_no_frame(tmp_path):
    first = build_indexes(scenes(), tmp_path, PARAMETERS)
    again = scenes()
    second = build_indexes(again, str(tmp_path), PARAMETERS)
    assert [sequence.reads for sequence in again] == [0, 0, 0]
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.read().survivors, b.read().survivors)
        np.testing.assert_array_equal(a.read().offsets, b.read().offsets)


def test_only_what_is_missing_is_measured_and_put_in_its_place(tmp_path):
    sequences = scenes()
    build_indexes([sequences[0], sequences[2]], tmp_path, PARAMETERS)
    fresh = scenes()
    built = build_indexes(fresh, tmp_path, PARAMETERS)
    assert [sequence.reads for sequence in fresh] == [0, 5, 0]
    for sequence, index in zip(fresh, built, strict=True):
        np.testing.assert_array_equal(index.read().survivors, measure_overlap(sequence, PARAMETERS).survivors)


def test_other_parameters_measure_anew(tmp_path):
    build_indexes(scenes(), tmp_path, PARAMETERS)
    again = scenes()
    built = build_indexes(again, tmp_path, OverlapParameters(spacing=24))
    assert [sequence.reads for sequence in again] == [5, 5, 5]
    assert built[0].read().points[0] < measure_overlap(again[0], PARAMETERS).points[0]


def test_a_damaged_index_is_measured_anew(tmp_path):
    build_indexes(scenes()[:1], tmp_path, PARAMETERS)
    index_path(tmp_path, scenes()[0]).write_bytes(b"")
    again = scenes()[:1]
    build_indexes(again, tmp_path, PARAMETERS)
    assert again[0].reads == 5
    assert load_index(index_path(tmp_path, again[0]), PARAMETERS.signature(again[0])) is not None


def test_an_interrupted_build_keeps_what_it_finished(tmp_path):
    good, bad, later = film(5, name="good"), Damaged(film(6).frames, "bad"), film(5, seed=2, name="later")
    bad.bad = (5, 1, 3)
    with pytest.raises(
        BadInputError, match="half of the frames of bad can't be read; the first of them: frame 1 of bad"
    ):
        build_indexes([good, bad, later], tmp_path, PARAMETERS, workers=1)
    assert load_index(index_path(tmp_path, good), PARAMETERS.signature(good)) is not None
    assert load_index(index_path(tmp_path, bad), PARAMETERS.signature(bad)) is None
    assert not list(tmp_path.glob("*.tmp"))
    again = film(5, name="good")
    build_indexes([again, later], tmp_path, PARAMETERS, workers=1)
    assert again.reads == 0


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit])
def test_ctrl_c_does_not_wait_for_the_end_of_a_long_sequence(tmp_path, stop):
    """As a signal does, the exception comes in the main thread, which waits for a thread that measures."""
    began, frames = threading.Event(), []

    def long_sequence(on_frame) -> None:
        for index in range(20_000):
            on_frame()
            frames.append(index)
            began.set()
            time.sleep(1e-3)

    def main() -> None:
        with measuring_threads(1, lambda: None) as (pool, on_frame):
            pool.submit(long_sequence, on_frame)
            assert began.wait(10)
            raise stop

    with pytest.raises(stop):
        main()
    assert len(frames) < 20_000


def test_an_error_of_one_sequence_lets_the_others_end(tmp_path):
    began, frames = threading.Event(), []

    def sequence(on_frame) -> None:
        for index in range(20):
            on_frame()
            frames.append(index)
            began.set()
            time.sleep(1e-3)

    def main() -> None:
        with measuring_threads(1, lambda: None) as (pool, on_frame):
            pool.submit(sequence, on_frame)
            assert began.wait(10)
            raise BadInputError("another sequence can't be read")

    with pytest.raises(BadInputError):
        main()
    assert len(frames) == 20


def test_sequences_of_one_name_keep_their_own_index(tmp_path):
    def pair():
        return [film(4, name="same"), film(6, seed=3, name="same")]

    build_indexes(pair(), tmp_path, PARAMETERS)
    again = pair()
    built = build_indexes(again, tmp_path, PARAMETERS)
    assert [len(index) for index in built] == [4, 6]
    assert [sequence.reads for sequence in again] == [0, 0]


def test_nothing_to_build(tmp_path):
    assert build_indexes([], tmp_path / "unused", PARAMETERS) == []
    assert not (tmp_path / "unused").exists()


def test_a_range_of_frames_is_a_part_of_the_whole(tmp_path):
    whole = film(9)
    early, late = frame_ranges([whole], 0, 0.7)[0], frame_ranges([whole], 0.7, 1)[0]
    inner = FrameRange(FrameRange(whole, 2, 9), 1, 5)
    parts = build_indexes([early, late, inner], tmp_path, PARAMETERS)
    assert whole.reads == 9  # once for all
    expected = measure_overlap(whole, PARAMETERS)
    for part, start, stop in zip(parts, (0, 6, 3), (6, 9, 7), strict=True):
        assert len(part) == stop - start
        for i in range(len(part)):
            np.testing.assert_array_equal(part.read().overlap(i), expected.overlap(start + i)[: stop - start - i - 1])
    again = film(9)
    build_indexes([FrameRange(again, 4, 8)], tmp_path, PARAMETERS)
    assert again.reads == 0


def test_unreadable_frames_are_remembered_and_counted_in_parts(tmp_path):
    def damaged():
        return Damaged(film(9).frames, "bad")

    build_indexes([damaged()], tmp_path, PARAMETERS)
    again = damaged()
    (index,) = build_indexes([again], tmp_path, PARAMETERS)
    assert again.reads == 0
    assert index.unreadable == {3: "frame 3 of bad cannot be read"}
    parts = build_indexes([FrameRange(again, 2, 7), FrameRange(again, 4, 9)], tmp_path, PARAMETERS)
    assert [set(part.unreadable) for part in parts] == [{1}, set()]
    assert unreadable_frames(parts) == ["frame 3 of bad cannot be read"]


def test_a_frame_that_can_be_read_again_is_measured(tmp_path):
    away = Damaged(film(9).frames, "bad")
    build_indexes([away], tmp_path, PARAMETERS)
    away.bad = ()
    (index,) = build_indexes([away], tmp_path, PARAMETERS)
    assert not index.unreadable
    np.testing.assert_array_equal(index.read().survivors, measure_overlap(film(9), PARAMETERS).survivors)


def test_evaluations_need_every_frame(tmp_path):
    bad = Damaged(film(9).frames, "bad")
    bad.bad = (2, 4, 7)
    require_readable(build_indexes([film(5, name="good")], tmp_path, PARAMETERS))
    with pytest.raises(
        BadInputError, match=r"needs every frame, but frame 2 of bad cannot be read \(and 2 frames more\)"
    ):
        require_readable(build_indexes([film(5, name="good"), bad], tmp_path, PARAMETERS))
