import warnings

import pytest
from textured_scenes import film

from sips_lit.errors import BadInputError, InputWarning, LeftOutWarning, StorageError
from sips_lit.frames.recording import Recording, RecordingLoader


def slow(counts: dict[str, list[int]], opened: list[str]) -> list[Recording]:
    """Films of so many frames; ``opened`` tells which were opened."""

    def open_one(name: str):
        opened.append(name)
        return [film(count, name=f"{name}{count}") for count in counts[name]]

    return [Recording(name, lambda name=name: open_one(name)) for name in counts]


def test_a_loader_opens_all_and_lists_without_opening():
    loader, opened = RecordingLoader(slow), []
    listed = loader.recordings({"a": [3, 4], "b": [2]}, opened)
    assert ([recording.where for recording in listed], opened) == (["a", "b"], [])
    assert [sequence.name for sequence in loader({"a": [3, 4], "b": [2]}, opened=opened)] == ["a3", "a4", "b2"]
    assert opened == ["a", "b"]
    assert loader.__doc__ == slow.__doc__


@pytest.mark.parametrize(
    ("counts", "sentence"), [({"a": [], "b": []}, "a, b has no shot"), ({}, "the data has no shot")]
)
def test_nothing_to_load(counts, sentence):
    with pytest.raises(BadInputError, match=sentence):
        RecordingLoader(slow)(counts, [])


def some_broken(errors: dict[str, Exception | None]) -> list[Recording]:
    """Recordings by name, those with an error can't be opened."""

    def open_one(name: str):
        if (error := errors[name]) is not None:
            raise error
        return [film(2, name=name)]

    return [Recording(name, lambda name=name: open_one(name)) for name in errors]


def test_a_broken_recording_costs_one_line():
    broken = {name: BadInputError(f"{name} is no video") for name in ("b", "d")}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        opened = RecordingLoader(some_broken)({"a": None, "b": broken["b"], "c": None, "d": broken["d"], "e": None})
    assert [sequence.name for sequence in opened] == ["a", "c", "e"]
    assert [str(warning.message) for warning in caught] == ["left out: b is no video", "left out: d is no video"]
    assert all(issubclass(warning.category, LeftOutWarning) for warning in caught)
    assert issubclass(LeftOutWarning, InputWarning)


@pytest.mark.filterwarnings("ignore::sips_lit.errors.LeftOutWarning")
@pytest.mark.parametrize(
    ("good", "error", "sentence"),
    [
        (0, BadInputError("x0 is no video"), r"^x0 is no video$"),
        (2, BadInputError("x0 is no video"), None),
        (1, BadInputError("x0 is no video"), r"^half of the 2 recordings can't be read; the first: x0 is no video$"),
        (5, StorageError("the disk is full"), r"^the disk is full$"),
        (5, KeyError("a defect"), "a defect"),
    ],
)
def test_when_loading_ends(good, error, sentence):
    errors = {f"x{at}": error if at == 0 else None for at in range(good + 1)}
    if sentence is None:
        assert len(RecordingLoader(some_broken)(errors)) == good
    else:
        with pytest.raises(type(error), match=sentence):
            RecordingLoader(some_broken)(errors)
