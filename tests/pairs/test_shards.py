import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.errors import BadInputError
from sips_lit.frames.recording import Recording
from sips_lit.pairs.index_run import share


def recordings(names) -> list[Recording]:
    return [Recording(name, list) for name in names]


@given(st.sets(st.text("abc/", max_size=4), max_size=20), st.integers(1, 12), st.randoms())
@settings(max_examples=50, deadline=None)
def test_every_recording_is_in_exactly_one_share(names, count, random):
    shuffled = list(names)
    random.shuffle(shuffled)
    shares = [share(recordings(shuffled), f"{i}/{count}") for i in range(1, count + 1)]
    assert sorted(recording.where for part in shares for recording in part) == sorted(names)
    assert max(map(len, shares)) - min(map(len, shares)) <= 1
    # the same whatever order files were found in
    assert shares[0] == share(recordings(sorted(names)), f"1/{count}")


def test_all_in_one():
    assert [recording.where for recording in share(recordings("cab"), "1/1")] == ["a", "b", "c"]


@pytest.mark.parametrize("shard", ["0/4", "5/4", "x", "1", "1/0", "-1/4", "1/4/2", "", "1.5/4", "1 / 4"])
def test_no_shares(shard):
    with pytest.raises(BadInputError, match=f"shard is {shard}: give a part and the number of parts"):
        share([], shard)
