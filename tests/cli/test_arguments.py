import random
import string
import subprocess
import sys
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from sips_lit.cli.arguments import as_typed, quoted, with_keys
from sips_lit.errors import BadInputError

NAMES = ["2024_01_01", "10", "1e3", "0x10", "true", "inf", "a (copy).mp4", "a=b", "it's", 'say "x"', "#1", "~x", "a~b"]
NAMES += [
    "C:\\videos\\a.mp4",
    "end\\",
    "\\'",
    "{a}",
    "a:b",
    "12:30.mp4",
    "[1] take",
    "a,b",
    "two  words",
    " b ",
    "[1] take [2]",
    "glob(a)",
    "choice(a,b)",
    "a;b&c|d*?!`",
    "-x",
    "+x",
    "=",
    "東京",
    "@x",
    "$x",
    "a]",
]


def parsed(argument: str) -> object:
    """What the configuration gets."""
    return OverridesParser.create().parse_override(argument).value()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "key",
    [
        "data.path",
        "input",
        "output",
        "paths.outputs",
        "+pair_sets.a.data.path",
        "hydra.run.dir",
        "callbacks.checkpoint.filename",
    ],
)
def test_paths_are_text(key: str, name: str):
    (argument,) = as_typed([f"{key}={name}"])
    assert parsed(argument) == name


def test_any_characters():
    source = random.Random(0)
    for _ in range(400):
        name = "".join(source.choices(string.printable.strip() + " ", k=source.randint(1, 8))).strip()
        if not name or name[0] in "'\"[" or name in ("~", "null") or name.startswith("~/") or "${" in name:
            continue
        (argument,) = as_typed([f"data.path={name}"])
        assert parsed(argument) == name


def test_lists_and_sweeps():
    (argument,) = as_typed(["data.path=[2024_01, a (1).mp4,b[1],'c,d', it's ,'e]"])
    assert parsed(argument) == ["2024_01", "a (1).mp4", "b[1]", "c,d", "it's", "'e"]
    assert parsed(as_typed(["data.path=[]"])[0]) == []
    for multirun in ("-m", "--multirun", "hydra.mode=MULTIRUN"):
        _, argument = as_typed([multirun, "data.path=2024_01,a (1),'b,c',10"])
        assert [each.text for each in parsed(argument).list] == ["2024_01", "a (1)", "b,c", "10"]  # type: ignore[attr-defined]
    assert as_typed(["-m", "data.path=choice(a,b)"]) == ["-m", "data.path=choice(a,b)"]
    assert parsed(as_typed(["-m", "hydra.sweep.dir=a,b"])[1]) == "a,b"
    _, argument = as_typed(["-m", "data.path=[1e3,b],[c,'d,e'],f"])
    first, second, third = parsed(argument).list  # type: ignore[attr-defined]
    assert [each.text for each in first] == ["1e3", "b"]
    assert [each.text for each in second] == ["c", "d,e"]
    assert third.text == "f"


def test_what_stays():
    for argument in (
        "data.path=null",
        "data.path='a b'",
        'data.path="a b"',
        "data.path=",
        "k=10",
        "n=1e3",
        "--cfg=job",
        "~data",
    ):
        assert as_typed([argument]) == [argument]


def test_home(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", "/home/ada")
    assert parsed(as_typed(["data.path=~/films/1"])[0]) == "/home/ada/films/1"
    assert parsed(as_typed(["data.path=[~/a,~b]"])[0]) == ["/home/ada/a", "~b"]


def test_an_argument_that_cannot_be_read():
    with pytest.raises(BadInputError, match=r"the argument title=a\(1\) can't be read .*: \"title='a\(1\)'\""):
        as_typed(["title=a(1)"])
    with pytest.raises(BadInputError, match=r"the argument data\.path = x can't be read .*: \"data\.path='x'\""):
        as_typed(["data.path = x"])
    for argument in ("clip.mp4", "/data/a (1).mp4", "data.path", "=x", "in put=x"):
        with pytest.raises(BadInputError, match="is no key=value, such as"):
            as_typed(["-m", argument])
    for option in (["--config-dir", "a b"], ["-cn", "x"], ["--cfg", "job"], ["~data"], ["--help"]):
        assert as_typed(option) == option
    assert parsed("title=" + quoted("a(1)")) == "a(1)"


def test_a_result_is_written_where_it_was_told(tmp_path: Path):
    """sips-detect with names that are numbers: the error names them, not what they would be as numbers."""
    command = [sys.executable, "-m", "sips_lit.cli.detect", "checkpoint=10", "input=1e3", "output=2024_01_02"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert " 10" in done.stderr
    assert "1000" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_names_that_no_file_has():
    assert parsed(as_typed([f"data.path=/{'a' * 255}/b"])[0]) == f"/{'a' * 255}/b"
    for value in ("a" * 256, "b/" + "é" * 128, f"[a,{'b' * 256}]"):
        with pytest.raises(BadInputError, match="can't be a path: the name of a file or folder has at most 255 bytes"):
            as_typed([f"data.path={value}"])


def test_plain_arguments_are_the_files_of_a_command_that_takes_them(tmp_path):
    odd = tmp_path / "run=1"
    odd.mkdir()
    given = ["a b.json", "labels={a: b}", "--config-dir", "conf", str(odd), "it's", "-m", "c.json"]
    *others, last = as_typed(with_keys("report", given))
    assert others == ["labels={a: b}", "--config-dir", "conf", "-m"]
    assert last.startswith("results=[")
    assert parsed(last) == ["a b.json", str(odd), "it's", "c.json"]
    assert with_keys("report", ["results=a"]) == ["results=a"]
    assert with_keys("detect", ["photo.jpg"]) == ["photo.jpg"]
