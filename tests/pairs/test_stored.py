import json
import os
import pickle

import numpy as np
import pytest
from overlap_rows import rows_of
from textured_scenes import Damaged, film

import sips_lit.pairs.stored
from sips_lit.errors import BadInputError
from sips_lit.frames.views import FrameRange
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap
from sips_lit.pairs.stored import NAME, Catalogue, StoredIndex

PARAMETERS = OverlapParameters()


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Everything that was read is worth keeping."""
    monkeypatch.setattr(sips_lit.pairs.stored, "SAVE_AFTER", -1.0)


@pytest.fixture
def loads(monkeypatch) -> list[str]:
    """Names of the files that were read."""
    names: list[str] = []
    load = sips_lit.pairs.stored.load_index

    def noted(path, signature):
        names.append(path.name)
        return load(path, signature)

    monkeypatch.setattr(sips_lit.pairs.stored, "load_index", noted)
    monkeypatch.setattr("sips_lit.pairs.build.load_index", noted)
    return names


def stored(folder, *ranges) -> list[StoredIndex]:
    whole = film(9)
    return build_indexes([FrameRange(whole, *part) for part in ranges] or [whole], folder, PARAMETERS)


def test_an_index_is_read_from_its_file_and_held(tmp_path, loads):
    (index,) = stored(tmp_path)
    loads.clear()
    expected = measure_overlap(film(9), PARAMETERS)
    assert rows_of(index.read()) == rows_of(expected)
    np.testing.assert_array_equal(index.read().motion, expected.motion)
    assert len(loads) == 1
    assert len(index) == 9
    assert rows_of(pickle.loads(pickle.dumps(index)).read()) == rows_of(expected)  # as a worker gets it


def test_counts_are_those_of_the_index_and_read_once_for_ever(tmp_path, loads):
    targets = [(0.2, 0.9), (0.5, np.inf), (1.1, np.inf)]
    parts = [(0, 9), (0, 6), (6, 9)]
    first = [index.count(*target) for index in stored(tmp_path, *parts) for target in targets]
    whole = measure_overlap(film(9), PARAMETERS)
    slow = []
    for start, stop in parts:
        for target in targets:
            partners = [
                sum(target[0] <= value < target[1] for value in whole.overlap(frame)[: stop - frame - 1])
                for frame in range(start, stop)
            ]
            slow.append((sum(count > 0 for count in partners), sum(partners)))
    assert [(count.frames, count.pairs) for count in first] == slow
    assert slow[0][1] > slow[-1][1] == 0
    loads.clear()
    assert [index.count(*target) for index in stored(tmp_path, *parts) for target in targets] == first
    assert not loads


def test_an_index_that_changed_is_read_again(tmp_path, loads):
    (index,) = stored(tmp_path)
    before = index.count(0.2)
    os.utime(index.path, ns=(1, 1))
    loads.clear()
    assert stored(tmp_path)[0].count(0.2) == before
    assert len(loads) == 2  # whether it is up to date, and its counts


def test_other_parameters_are_not_confused(tmp_path):
    stored(tmp_path)
    (other,) = build_indexes([film(9)], tmp_path, OverlapParameters(spacing=24))
    expected = measure_overlap(film(9), OverlapParameters(spacing=24))
    assert other.count(0.5) == expected.count(0.5)
    assert rows_of(other.read()) == rows_of(expected)


@pytest.mark.parametrize("change", ["", "[]", "[1]", "null", '{"x": 3}', "\0\xff", "cut", "counts", "frames"])
def test_a_damaged_catalogue_is_made_anew(tmp_path, change):
    (index,) = stored(tmp_path)
    count = index.count(0.2)
    text = (tmp_path / NAME).read_text()
    entries = json.loads(text)
    (name,) = entries
    if change == "cut":
        change = text[: len(text) // 2]
    elif change == "counts":
        change = json.dumps({name: entries[name] | {"counts": {"0:9:0.2:inf": 3}}})
    elif change == "frames":
        change = json.dumps({name: entries[name] | {"counts": {"0:9:0.2:inf": {"frames": "7", "pairs": 3}}}})
    (tmp_path / NAME).write_text(change)
    assert stored(tmp_path)[0].count(0.2) == count


def test_catalogues_of_two_processes_join_and_forget_what_is_gone(tmp_path):
    (mine,) = stored(tmp_path)
    others = Catalogue(tmp_path)
    build_indexes([film(5, name="other")], tmp_path, PARAMETERS)
    mine.count(0.3)
    assert len(json.loads((tmp_path / NAME).read_bytes())) == 2
    mine.path.unlink()
    (other,) = build_indexes([film(5, name="other")], tmp_path, PARAMETERS)
    other.count(0.3)
    assert list(json.loads((tmp_path / NAME).read_bytes())) == [other.path.name]
    assert len(others.entries) == 1


def test_little_work_leaves_no_catalogue(tmp_path, monkeypatch):
    monkeypatch.setattr(sips_lit.pairs.stored, "SAVE_AFTER", 60.0)
    stored(tmp_path)[0].count(0.2)
    assert not (tmp_path / NAME).exists()


def test_a_folder_that_can_only_be_read(tmp_path, monkeypatch):
    monkeypatch.setattr(sips_lit.pairs.stored, "SAVE_AFTER", 60.0)
    (index,) = stored(tmp_path)
    monkeypatch.setattr(sips_lit.pairs.stored, "SAVE_AFTER", -1.0)
    (tmp_path / NAME).mkdir()
    assert index.count(0.2).pairs > 0
    assert stored(tmp_path)[0].count(0.2) == index.count(0.2)


def test_unreadable_frames_are_known_without_the_file(tmp_path, loads):
    def damaged():
        whole = Damaged(film(9).frames, "bad")
        whole.bad = (1, 3, 8)
        return FrameRange(whole, 2, 8)

    build_indexes([damaged()], tmp_path, PARAMETERS)
    (index,) = build_indexes([damaged()], tmp_path, PARAMETERS)
    loads.clear()
    assert index.unreadable == {1: "3.png is damaged"}
    assert not loads
    assert index.read().unreadable == index.unreadable


def test_an_index_that_is_gone_is_told(tmp_path):
    (index,) = stored(tmp_path)
    index.path.unlink()
    with pytest.raises(BadInputError, match=r"the overlap index .*npz is gone or damaged: run again"):
        index.read()


def test_a_damaged_index_is_told_and_measured_by_the_next_run(tmp_path):
    (index,) = stored(tmp_path)
    content, times = index.path.read_bytes(), index.path.stat()
    index.path.write_bytes(content[:300] + b"damaged" + content[307:])
    os.utime(index.path, ns=(times.st_atime_ns, times.st_mtime_ns))  # as a disk does that fails
    with pytest.raises(BadInputError, match="gone or damaged"):
        stored(tmp_path)[0].read()
    assert rows_of(stored(tmp_path)[0].read()) == rows_of(measure_overlap(film(9), PARAMETERS))


def test_both_parts_of_a_split_are_counted_at_one_reading(tmp_path, loads):
    early, late = stored(tmp_path, (0, 6), (6, 9))
    loads.clear()
    whole = measure_overlap(film(9), PARAMETERS)
    assert early.count(0.3) == whole.part(0, 6).count(0.3)
    assert late.count(0.3) == whole.part(6, 9).count(0.3)
    assert len(loads) == 1
