import math

import pytest
from textured_scenes import flight

from sips_lit.errors import BadInputError
from sips_lit.pairs.choice import ListedPair, read_pair_file, write_pair_file

SEQUENCES = [flight(5, size=(40, 30), name="a"), flight(8, size=(40, 30), name="b")]


def read(tmp_path, text: str):
    path = tmp_path / "pairs.csv"
    path.write_text(text)
    return [(p.sequence, p.index0, p.index1) for p in read_pair_file(path, SEQUENCES)]


def test_round_trip(tmp_path):
    pairs = [ListedPair(1, 7, 2, 0.1 + 0.2), ListedPair(0, 0, 4, math.nan)]
    write_pair_file(tmp_path / "new" / "p.csv", SEQUENCES, pairs)
    back = read_pair_file(tmp_path / "new" / "p.csv", SEQUENCES)
    assert back[0] == pairs[0]
    assert (back[1].sequence, back[1].index0, back[1].index1) == (0, 0, 4)
    assert math.isnan(back[1].overlap)


@pytest.mark.parametrize(
    "text",
    [
        "a 0 3\nb 2 1\n",
        "a,0,3\nb,2,1",
        "# mine\n\nsequence frame0 frame1\na 0 3\n\nb 2 1\n",
        "sequence,index0,index1,overlap\na,0,3,0.5\nb,2,1,",
        "a a_000000 a_000003\nb b_000002 1",
        "\ufeffa 0 3\r\nb 2 1\r\n",
    ],
)
def test_ways_to_write_it(tmp_path, text):
    assert read(tmp_path, text) == [(0, 0, 3), (1, 2, 1)]


class Numbered(type(SEQUENCES[0])):
    """Names that look like indices, as those of images numbered from 1 do."""

    def frame_name(self, index):
        return str(index + 1)


def test_a_name_wins_unless_the_head_says_index(tmp_path):
    sequence = Numbered(SEQUENCES[0].frames, "n")
    path = tmp_path / "p"
    for text, expected in (("n 1 5", (0, 4)), ("n 0 2", (0, 1)), ("sequence index0 index1\nn 1 4", (1, 4))):
        path.write_text(text)
        (pair,) = read_pair_file(path, [sequence])
        assert (pair.index0, pair.index1) == expected
    write_pair_file(path, [sequence], [ListedPair(0, 1, 4, 0.5)])
    assert read_pair_file(path, [sequence]) == [ListedPair(0, 1, 4, 0.5)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a 0 3\na 0 9\n", "line 2 of the pair list .* names frame 9, which a lacks: it has frames 0 to 4"),
        ("a 0 x7\n", "names frame x7, which a lacks"),
        ("a 0 -1\n", "names frame -1"),
        ("c 0 1\n", "names the sequence c, which the data lacks: it has a, b"),
        ("a 0\n", "line 1 .* has 2 fields"),
        ("a 2 2\n", "pairs frame 2 with itself"),
        ("a,0,1,much\n", "has much as its overlap"),
        ("a,0,1,inf\n", "has inf as its overlap: give a number from 0 to 1"),
        ("a,0,1,-0.1\n", "has -0.1 as its overlap"),
        (f"a 0 {'9' * 5000}\n", r"names frame 9+\.\.\. which a lacks"),
        ("sequence frame0 frame1\n", "has no pairs"),
        ("", "has no pairs"),
    ],
)
def test_one_sentence_for_what_can_not_be_used(tmp_path, text, words):
    with pytest.raises(BadInputError, match=words):
        read(tmp_path, text)


def test_no_file(tmp_path):
    with pytest.raises(BadInputError, match="can't be read: No such file"):
        read_pair_file(tmp_path / "gone", SEQUENCES)
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00\xd8")
    with pytest.raises(BadInputError, match="it is no text"):
        read_pair_file(tmp_path / "bytes", SEQUENCES)
