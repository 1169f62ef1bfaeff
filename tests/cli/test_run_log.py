import io
import sys
import threading

import pytest
from tqdm import tqdm

from sips_lit.cli.run_log import CopiedStream, logged


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_what_is_printed_is_on_the_terminal_and_in_the_log(tmp_path, capsys):
    with logged(tmp_path / "run.log"):
        print("one\n\ntwo", 3)
        print("warning: four", file=sys.stderr)
        print("no end", end="")
    out, err = capsys.readouterr()
    assert (out, err) == ("one\n\ntwo 3\nno end", "warning: four\n")
    assert (tmp_path / "run.log").read_text() == "one\n\ntwo 3\nwarning: four\n"
    print("after")
    assert "after" not in (tmp_path / "run.log").read_text()


def test_bars_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with logged(tmp_path / "run.log"):
        assert sys.stderr.isatty()
        outer = tqdm(range(3), file=sys.stderr, desc="outer", mininterval=0)
        for _ in outer:
            list(tqdm(range(3), file=sys.stderr, desc="inner", mininterval=0, position=1, leave=False))
        print("warning: kept", file=sys.stderr)
    assert "inner" in sys.stderr.getvalue()
    assert (tmp_path / "run.log").read_text() == "warning: kept\n"


def test_a_stream_that_outlives_the_run_goes_on_to_the_terminal(tmp_path, capsys):
    with logged(tmp_path / "run.log"):
        kept = sys.stderr
    print("late", file=kept)
    assert capsys.readouterr().err == "late\n"
    assert (tmp_path / "run.log").read_text() == ""


def test_a_defect_leaves_its_traceback(tmp_path, capsys):
    with pytest.raises(ZeroDivisionError), logged(tmp_path / "run.log"):
        1 / 0  # noqa: B018
    assert "ZeroDivisionError" in (tmp_path / "run.log").read_text()
    assert capsys.readouterr().err == "", "the program prints it at its end"


def test_a_full_disk_does_not_stop_the_run(capsys):
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError("no space")

    stream = CopiedStream(sys.stdout, Full(), True)
    print("said", file=stream)
    assert capsys.readouterr().out == "said\n"


def test_lines_of_threads_stay_whole(tmp_path, capsys):
    with logged(tmp_path / "run.log"):
        threads = [threading.Thread(target=sys.stdout.write, args=(f"{'x' * 50}{i}\n",)) for i in range(20)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert sorted((tmp_path / "run.log").read_text().splitlines()) == sorted(f"{'x' * 50}{i}" for i in range(20))


def test_without_a_file_nothing_changes():
    before = sys.stdout
    with logged(None):
        assert sys.stdout is before
