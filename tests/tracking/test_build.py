import numpy as np
import pytest
from textured_scenes import ArraySequence, film

from sips_lit.errors import BadInputError
from sips_lit.tracking.build import build_indexes
from sips_lit.tracking.overlap import OverlapParameters, index_path, load_index, measure_overlap

PARAMETERS = OverlapParameters()


class BrokenSequence(ArraySequence):
    def frame(self, index):
        if index == 3:
            raise BadInputError("frame 3 cannot be read")
        return super().frame(index)


def scenes() -> list[ArraySequence]:
    return [film(5, seed=seed, name=f"flight{seed}") for seed in range(3)]


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_in_the_order_of_the_sequences_whatever_the_workers(tmp_path, workers):
    sequences = scenes()
    built = build_indexes(sequences, tmp_path, PARAMETERS, workers)
    for sequence, index in zip(sequences, built, strict=True):
        expected = measure_overlap(sequence, PARAMETERS)
        np.testing.assert_array_equal(index.survivors, expected.survivors)
        np.testing.assert_array_equal(index.points, expected.points)


def test_a_second_call_reads_no_frame(tmp_path):
    first = build_indexes(scenes(), tmp_path, PARAMETERS)
    again = scenes()
    second = build_indexes(again, str(tmp_path), PARAMETERS)
    assert [sequence.reads for sequence in again] == [0, 0, 0]
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.survivors, b.survivors)
        np.testing.assert_array_equal(a.offsets, b.offsets)


def test_only_what_is_missing_is_measured_and_put_in_its_place(tmp_path):
    sequences = scenes()
    build_indexes([sequences[0], sequences[2]], tmp_path, PARAMETERS)
    fresh = scenes()
    built = build_indexes(fresh, tmp_path, PARAMETERS)
    assert [sequence.reads for sequence in fresh] == [0, 5, 0]
    for sequence, index in zip(fresh, built, strict=True):
        np.testing.assert_array_equal(index.survivors, measure_overlap(sequence, PARAMETERS).survivors)


def test_other_parameters_measure_anew(tmp_path):
    build_indexes(scenes(), tmp_path, PARAMETERS)
    again = scenes()
    built = build_indexes(again, tmp_path, OverlapParameters(spacing=24))
    assert [sequence.reads for sequence in again] == [5, 5, 5]
    assert built[0].points[0] < measure_overlap(again[0], PARAMETERS).points[0]


def test_a_damaged_index_is_measured_anew(tmp_path):
    build_indexes(scenes()[:1], tmp_path, PARAMETERS)
    index_path(tmp_path, scenes()[0]).write_bytes(b"")
    again = scenes()[:1]
    build_indexes(again, tmp_path, PARAMETERS)
    assert again[0].reads == 5
    assert load_index(index_path(tmp_path, again[0]), PARAMETERS.signature(again[0])) is not None


def test_an_interrupted_build_keeps_what_it_finished(tmp_path):
    good, bad, later = film(5, name="good"), BrokenSequence(film(6).frames, "bad"), film(5, seed=2, name="later")
    with pytest.raises(BadInputError, match="frame 3 cannot be read"):
        build_indexes([good, bad, later], tmp_path, PARAMETERS, workers=1)
    assert load_index(index_path(tmp_path, good), PARAMETERS.signature(good)) is not None
    assert load_index(index_path(tmp_path, bad), PARAMETERS.signature(bad)) is None
    assert not list(tmp_path.glob("*.tmp"))
    again = film(5, name="good")
    build_indexes([again, later], tmp_path, PARAMETERS, workers=1)
    assert again.reads == 0


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
