import cv2
import pytest
from textured_scenes import ArraySequence, Damaged, film

from sips_lit.errors import BadInputError
from sips_lit.frames.recording import Recording
from sips_lit.frames.views import FrameRange
from sips_lit.pairs.index_file import index_path, load_index
from sips_lit.pairs.index_run import IndexedSequence, index_recordings
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap

PARAMETERS = OverlapParameters()


def failing(error: Exception) -> Recording:
    def fail():
        raise error

    return Recording("bad.mp4", fail)


def run(recordings, folder, workers=1, overlap=0.5) -> dict[str, list[IndexedSequence]]:
    results = list(index_recordings(recordings, folder, PARAMETERS, overlap, workers))
    by_name = {rows[0].recording: rows for rows in results}
    assert len(by_name) == len(results)
    return by_name


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_numbers_of_every_sequence(tmp_path, workers):
    shots = [film(6, name="a_shot0"), film(9, step=(9, 3), seed=1, name="a_shot1")]
    recordings = [Recording("a.mp4", lambda: shots), Recording("b.mp4", lambda: [film(3, seed=2, name="b")])]
    results = run(recordings, tmp_path, workers)
    assert [[row.sequence for row in results[name]] for name in ("a.mp4", "b.mp4")] == [["a_shot0", "a_shot1"], ["b"]]
    for row, sequence in zip(results["a.mp4"], shots, strict=True):
        index = measure_overlap(sequence, PARAMETERS)
        pairs = sum(int((index.overlap(i) >= 0.5).sum()) for i in range(len(index)))
        assert (row.frames, row.points, row.pairs) == (len(sequence), int(index.points.mean()), pairs)
        assert (row.unreadable, row.problem, row.failed) == (0, "", False)
        assert load_index(index_path(tmp_path, sequence), PARAMETERS.signature(sequence)) is not None
    assert 0 < results["a.mp4"][1].pairs < 9 * 8 / 2  # so fast that not all frames overlap


@pytest.mark.parametrize("error", [BadInputError("bad.mp4 is\ndamaged"), OSError(5, "damaged"), cv2.error("damaged")])
def test_one_that_fails_stops_no_other(tmp_path, error):
    good = [Recording(f"{name}.mp4", lambda name=name: [film(4, name=name)]) for name in "ac"]
    results = run([good[0], failing(error), good[1]], tmp_path)
    assert [results[f"{name}.mp4"][0].failed for name in "ac"] == [False, False]
    (row,) = results["bad.mp4"]
    assert row.failed
    assert "damaged" in row.problem
    assert "\n" not in row.problem


def test_a_recording_may_fail_in_part(tmp_path):
    class Gone(ArraySequence):
        def frame(self, index):
            raise BadInputError("gone")

    shots = [film(4, name="a_shot0"), Gone(film(4).frames, "a_shot1")]
    rows = run([Recording("a.mp4", lambda: shots)], tmp_path)["a.mp4"]
    assert [(row.sequence, row.failed) for row in rows] == [("a_shot0", False), ("", True)]


def test_nothing_in_a_recording(tmp_path):
    (row,) = run([Recording("slides.mp4", list)], tmp_path)["slides.mp4"]
    assert row.failed
    assert row.problem == "slides.mp4 has no shot of two frames or more"


def test_defects_of_the_program_are_no_failures_of_recordings(tmp_path):
    with pytest.raises(ZeroDivisionError):
        run([failing(ZeroDivisionError())], tmp_path)


def test_an_interrupted_run_finds_what_was_finished(tmp_path):
    sequences = [film(5, seed=i, name=f"s{i}") for i in range(3)]
    recordings = [Recording(s.name, lambda s=s: [s]) for s in sequences]
    stream = index_recordings(recordings, tmp_path, PARAMETERS, 0.5, 1)
    next(stream)
    stream.close()
    again = [film(5, seed=i, name=f"s{i}") for i in range(3)]
    run([Recording(s.name, lambda s=s: [s]) for s in again], tmp_path)
    assert again[0].reads == 0
    assert again[2].reads == 5


def test_unreadable_frames_are_told(tmp_path):
    walk = Damaged(film(8).frames, "walk")
    walk.bad = (2, 6)
    recording = Recording("walk", lambda: [walk])
    for _ in range(2):  # measured, then stored
        (row,) = run([recording], tmp_path)["walk"]
        assert (row.frames, row.unreadable, row.problem, row.failed) == (8, 2, "2.png is damaged", False)


def test_ranges_of_frames_share_the_index_of_the_whole(tmp_path):
    whole = film(9)
    run([Recording("whole", lambda: [whole])], tmp_path)
    reads = whole.reads
    (row,) = run([Recording("part", lambda: [FrameRange(whole, 3, 7)])], tmp_path)["part"]
    assert (row.frames, row.pairs) == (4, 6)
    assert whole.reads == reads
