from pathlib import Path

import numpy as np
import pytest

from sips_lit.datasets.layout import (
    describe_place,
    expect,
    files_fingerprint,
    listed_file,
    read_pose_rows,
    read_rows,
    read_table,
    to_integer,
)
from sips_lit.errors import BadInputError
from sips_lit.frames.images import check_max_side


def write(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


def test_expect_says_what_is_there_instead(tmp_path: Path):
    file = write(tmp_path / "times.txt", "1\n")
    assert expect(file, "anything") == file
    (tmp_path / "images").mkdir()
    with pytest.raises(
        BadInputError, match=rf"no {tmp_path}/calib\.txt: .* has images/, times\.txt; it has a calib\.txt"
    ):
        expect(tmp_path / "calib.txt", "it has a calib.txt")


def test_places_in_words(tmp_path: Path):
    assert describe_place(tmp_path).endswith("is empty")
    assert describe_place(tmp_path / "a" / "b") == (
        f"the folder {tmp_path / 'a' / 'b'} does not exist (the folder {tmp_path} exists)"
    )
    for i in range(9):
        (tmp_path / f"{i}.png").touch()
    (tmp_path / ".hidden").touch()
    assert describe_place(tmp_path).endswith("has 0.png, 1.png, 2.png, 3.png and 5 more")
    assert describe_place(tmp_path / "0.png").endswith("0.png is a file")


def test_tables_of_all_sorts(tmp_path: Path):
    spaces = write(tmp_path / "a.txt", "# x y\r\n1  2.5\t3\r\n\r\n  4 -5e-1 6\r\n")
    np.testing.assert_array_equal(read_table(spaces, 3), [[1, 2.5, 3], [4, -0.5, 6]])
    commas = write(tmp_path / "a.csv", "\ufeff#t,x\n1403715274312143104, 2\n")  # with the mark of Windows editors
    np.testing.assert_array_equal(read_table(commas, (8, 2), ","), [[1403715274312143104, 2]])
    assert read_rows(spaces) == [(2, ["1", "2.5", "3"]), (4, ["4", "-5e-1", "6"])]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n3 x\n", r"line 2 of .*t\.txt has 'x' where a number should be"),
        ("# head\n1 2\n3 nan\n", r"line 3 of .*t\.txt has 'nan': every number must be finite"),
        ("1 -inf\n", r"line 1 of .*t\.txt has '-inf'"),
        ("1 2\n3\n", r"line 2 of .*t\.txt has 1 values, not 2 or 4"),
        ("1 2\n1 2 3 4\n", r"line 2 of .*t\.txt has 4 values"),
        ("1 2 3\n", r"line 1 of .*t\.txt has 3 values, not 2 or 4"),
        ("\n# nothing\n", r"t\.txt has no numbers"),
    ],
)
def test_bad_tables_name_the_line(tmp_path: Path, text: str, message: str):
    with pytest.raises(BadInputError, match=message):
        read_table(write(tmp_path / "t.txt", text), (2, 4))


def test_files_that_are_no_text(tmp_path: Path):
    (tmp_path / "t.txt").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(BadInputError, match=r"t\.txt is not a text file"):
        read_table(tmp_path / "t.txt", 2)
    for path in (tmp_path / "gone.txt", tmp_path):
        with pytest.raises(BadInputError, match=f"cannot read {path}"):
            read_table(path, 2)


def test_pose_rows(tmp_path: Path):
    poses = read_pose_rows(write(tmp_path / "p.txt", "1 0 0 7 0 1 0 8 0 0 1 9\n0 -1 0 1 1 0 0 2 0 0 1 3\n"))
    np.testing.assert_array_equal(poses[0], [[1, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]])
    np.testing.assert_array_equal(poses[1] @ [1, 0, 0, 1], [1, 3, 3, 1])
    stretched, mirrored, far = "1 0 0 7 0 1 0 8 0 0 2 9", "1 0 0 7 0 1 0 8 0 0 -1 9", "1 0 0 1e300 0 1 0 8 0 0 1 9"
    for row in (stretched, mirrored, far, "1e308 1e308 0 7 1e308 -1e308 0 8 0 0 1 9", " ".join(["1e308"] * 12)):
        with pytest.raises(BadInputError, match=r"line 3 of .*p\.txt is no pose"):
            read_pose_rows(write(tmp_path / "p.txt", "1 0 0 7 0 1 0 8 0 0 1 9\n#\n" + row))


def test_fingerprints(tmp_path: Path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    files = [write(tmp_path / "a" / "1.png", "one"), write(tmp_path / "b" / "1.png", "one")]
    prints = {files_fingerprint(files), files_fingerprint(files[:1]), files_fingerprint(files, 5)}
    assert len(prints) == 3
    assert files_fingerprint(files) in prints
    write(files[1], "other")
    assert files_fingerprint(files) not in prints
    with pytest.raises(BadInputError, match=r"cannot read .*2\.png"):
        files_fingerprint([tmp_path / "2.png"])


def test_max_side():
    check_max_side(None)
    check_max_side(16)
    with pytest.raises(BadInputError, match=r"data\.max_side is 15"):
        check_max_side(15)


@pytest.mark.parametrize("field", ["", "-1", "1.0", "1_0", "٣", "9" * 5000, str(2**63)])
def test_integers_that_64_bits_do_not_hold(field: str):
    with pytest.raises(BadInputError, match=r"line 3 of t\.txt has .* not a time"):
        to_integer(Path("t.txt"), 3, field, "a time")


def test_integers():
    assert to_integer(Path("t.txt"), 3, "0012", "a time") == 12
    assert to_integer(Path("t.txt"), 3, str(2**63 - 1), "a time") == 2**63 - 1


@pytest.mark.parametrize("name", ["a" * 256, "b/" + "é" * 128, "a\0b", "\ud800"])
def test_names_that_no_file_has(name: str):
    with pytest.raises(BadInputError, match=r"line 4 of t\.txt names .*, which is no name of a file"):
        listed_file(Path("x"), name, "line 4 of t.txt")
    assert listed_file(Path("x"), "a" * 255, "line 4 of t.txt") == Path("x", "a" * 255)
