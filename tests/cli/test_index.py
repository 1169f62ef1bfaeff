import sys
import types
from pathlib import Path

import pytest
from cli_runs import write_frames
from omegaconf import OmegaConf
from own_dataset import write_walk
from textured_scenes import flight, texture

import sips_lit.pairs.build
from sips_lit.cli.index import recordings
from sips_lit.frames.recording import Recording, RecordingLoader


def files(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.npz")}


@pytest.fixture
def measured(monkeypatch) -> list[str]:
    """Names of the sequences whose overlap was measured."""
    names: list[str] = []
    measure = sips_lit.pairs.build.measure_overlap

    def counted(sequence, *rest):
        names.append(sequence.name)
        return measure(sequence, *rest)

    monkeypatch.setattr(sips_lit.pairs.build, "measure_overlap", counted)
    return names


def test_a_line_a_sequence_and_nothing_is_measured_twice(command, tmp_path, measured):
    for name, count in (("one", 6), ("two", 5)):
        write_frames(tmp_path / "all" / name, flight(count, size=(96, 80), name=name).frames)
    arguments = "index", "data=folder", f"data.path={tmp_path}/all"
    first = command(*arguments)
    assert first.code == 0, first.err
    rows = [line for line in first.out.splitlines() if line.startswith("| all_")]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [row[:2] for row in cells] == [["all_one", "6"], ["all_two", "5"]]
    assert [int(row[4]) for row in cells] == [15, 10]  # all pairs of so slow a flight
    assert f"indexes: {tmp_path}/data/indexes" in first.out
    assert sorted(measured) == ["all_one", "all_two"]
    before = files(tmp_path / "data" / "indexes")
    assert len(before) == 2
    second = command(*arguments)
    assert second.out == first.out
    assert len(measured) == 2
    assert files(tmp_path / "data" / "indexes") == before


def test_new_frames_are_measured(command, tmp_path, measured):
    frames = flight(6, size=(96, 80)).frames
    folder = write_frames(tmp_path / "frames", frames[:5])
    arguments = "index", "data=folder", f"data.path={folder}"
    assert command(*arguments).code == 0
    write_frames(folder, frames)
    assert command(*arguments).code == 0
    assert len(measured) == 2
    assert command(*arguments, "overlap=0.9").code == 0  # asks another question of the same index
    assert len(measured) == 2
    assert command(*arguments, "overlap_parameters.spacing=24").code == 0
    assert len(measured) == 3


def test_frames_that_do_not_overlap_are_no_error(command, tmp_path):
    folder = write_frames(tmp_path / "cuts", [texture(80, 96, seed) for seed in range(5)])
    result = command("index", "data=folder", f"data.path={folder}")
    assert result.code == 0
    row = next(line for line in result.out.splitlines() if line.startswith("| cuts"))
    assert row.strip("|").split("|")[-1].strip() == "0"


def test_bad_input(command, tmp_path):
    assert command("index", "data=folder").sentence.startswith("data.path is not set")
    assert "there is no folder" in command("index", "data=folder", f"data.path={tmp_path}/gone").sentence
    folder = write_frames(tmp_path / "frames", flight(5).frames)
    for name in ("000", "002", "003"):
        (folder / f"{name}.png").write_bytes(b"\x89PNG nothing")
    sentence = command("index", "data=folder", f"data.path={folder}").sentence
    assert "1 of 1 recordings failed" in sentence
    assert "half of the frames of frames can't be read; the first of them: " in sentence
    assert f"{folder}/000.png is not an image" in sentence


def test_an_unreadable_frame_is_told_and_is_no_failure(command, tmp_path):
    folder = write_frames(tmp_path / "frames", flight(7, size=(96, 80)).frames)
    (folder / "002.png").write_bytes(b"\x89PNG nothing")
    result = command("index", "data=folder", f"data.path={folder}")
    assert result.code == 0, result.err
    row = next(line for line in result.out.splitlines() if line.startswith("| frames"))
    cells = [int(cell) for cell in row.strip("| ").split("|")[1:]]
    assert (cells[0], cells[3], cells[4]) == (7, 1 + 6, 1)  # pairs of frames 0 and 1, and of 3 to 6
    assert f"unreadable in frames: {folder}/002.png is not an image" in result.out
    evaluation = command("evaluate", "detector=fast", "data=folder", f"data.path={folder}", "checkpoint=none")
    assert f"an evaluation needs every frame, but {folder}/002.png is not" in evaluation.sentence


def test_a_loader_of_another_package(command, tmp_path, installed, measured):
    installed()
    for name, count in (("a", 4), ("b", 5)):
        write_walk(tmp_path / "walks" / name, flight(count, size=(96, 80), name=name).frames)
    given = "data=posed_depth", "data._target_=walks.walk.walk", f"data.path={tmp_path}/walks"
    result = command("index", *given, "shard=2/2")
    assert result.code == 0, result.err
    assert measured == ["b"]


def test_a_loader_that_lists_recordings_opens_only_those_of_the_share(tmp_path, monkeypatch):
    module = types.ModuleType("slow_films")
    opened = []

    @RecordingLoader
    def films(path):
        return [Recording(f"{path}/{name}", lambda name=name: opened.append(name) or [flight(3)]) for name in "ab"]

    module.films = films
    monkeypatch.setitem(sys.modules, "slow_films", module)
    config = {"_target_": "slow_films.films", "path": "x"}
    assert [part.where for part in recordings(OmegaConf.create(config))] == ["x/a", "x/b"]
    mixed = {"_target_": "some.mixture", "sources": {"one": {"sequences": config}, "none": None}}
    parts = recordings(OmegaConf.create(mixed))
    assert opened == []
    assert ([len(sequence) for sequence in parts[1].open()], opened) == ([3], ["b"])


def test_an_argument_called_sources_makes_no_mixture(monkeypatch):
    module = types.ModuleType("named_films")
    module.load = lambda sources: [flight(3, name=name) for name in sources]
    monkeypatch.setitem(sys.modules, "named_films", module)
    for sources in ({"a": 1, "b": 2}, {"a": {"length": 3}, "b": {"length": 4}}, ["a", "b"]):
        parts = recordings(OmegaConf.create({"_target_": "named_films.load", "sources": sources}))
        assert [part.where for part in parts] == ["a", "b"]
