import pytest
from textured_scenes import film

from sips_lit.errors import BadInputError
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
