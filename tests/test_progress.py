import re
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from streams import Clock, Stream
from tqdm import tqdm

import sips_lit.progress
from sips_lit.progress import ProgressLines, duration, progress, time_left


def written(seconds_per_item: float, items: int = 40, **options) -> list[tuple[float, str]]:
    """When which line was written, for items that take equally long."""
    clock, stream = Clock(), Stream(terminal=False)
    lines = ProgressLines(
        **{"iterable": range(items), "desc": "index", "unit": " frames", **options}, file=stream, clock=clock
    )
    start, seen = clock.now, []
    for _ in lines:
        clock.now += seconds_per_item
        seen += [None] * (len(stream.lines) - len(seen))  # the item before was counted only now
        seen = [s or (clock.now - seconds_per_item - start, line) for s, line in zip(seen, stream.lines, strict=True)]
    return seen


def as_stderr(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> Stream:
    """Standard error, a terminal or not."""
    stream = Stream(terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def test_a_line_in_ten_seconds():
    assert written(1.0) == [
        (2, "index: 2/40 frames (5 %), 38 s left"),
        (12, "index: 12/40 frames (30 %), 28 s left"),
        (22, "index: 22/40 frames (55 %), 18 s left"),
        (32, "index: 32/40 frames (80 %), 8 s left"),
    ]


def test_slow_items_get_a_line_each():
    assert [when for when, _ in written(25.0, 4)] == [25, 50, 75]


@pytest.mark.parametrize(("seconds", "items"), [(0.049, 40), (1.9, 1), (0.0, 1000)])
def test_nothing_of_work_that_ends_before_the_delay(seconds, items):
    assert written(seconds, items) == []


def test_the_delay_is_the_callers():
    assert written(1.0, 10, delay=6)[0] == (6, "index: 6/10 frames (60 %), 4 s left")


def test_items_done_before_do_not_count_as_pace():
    assert written(1.0, 5, total=105, initial=100)[0] == (2, "index: 102/105 frames (97 %), 3 s left")


@pytest.mark.parametrize("total", [None, 0, 1])
def test_without_a_total_or_with_one_that_is_wrong(total):
    assert written(1.0, 5, iterable=iter(range(5)), total=total)[0] == (2, "index: 2 frames, 2 s")


def test_bytes_are_megabytes():
    clock, stream = Clock(), Stream(terminal=False)
    with ProgressLines(desc="kitti.zip", unit="B", unit_scale=True, total=200e6, file=stream, clock=clock) as lines:
        clock.now += 5
        lines.update(12_340_000)
    assert stream.lines == ["kitti.zip: 12.3/200.0 MB (6 %), 76 s left"]


def test_a_total_may_grow():
    clock, stream = Clock(), Stream(terminal=False)
    lines = ProgressLines(desc="frames", unit=" frames", total=0, file=stream, clock=clock)
    lines.total += 50
    clock.now += 4
    lines.update(10)
    assert stream.lines == ["frames: 10/50 frames (20 %), 16 s left"]


def test_threads_share_a_display():
    clock, stream = Clock(), Stream(terminal=False)
    lines = ProgressLines(desc="frames", unit=" frames", total=4000, file=stream, clock=clock)
    clock.now += 3
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: [lines.update() for _ in range(500)], range(8)))
    assert len(stream.lines) == 1
    clock.now += 10
    lines.update(0)
    assert stream.lines[1] == "frames: 4000/4000 frames (100 %), 0 s left"


def test_a_log_gets_no_carriage_return(monkeypatch):
    err = as_stderr(monkeypatch, terminal=False)
    shown = progress(iter("abc"), desc="index", unit="frame", total=3, delay=0)
    assert list(shown) == ["a", "b", "c"]
    assert err.lines[0].startswith("index: 1/3 frames (33 %), ")
    assert len(err.lines) == 1
    assert "\r" not in err.getvalue()


def test_a_terminal_gets_a_bar_that_goes_away(monkeypatch):
    err = as_stderr(monkeypatch, terminal=True)
    shown = progress("abc", desc="index", unit="frame", delay=0)
    assert isinstance(shown, tqdm)
    assert list(shown) == ["a", "b", "c"]
    assert "index:   0%" in err.getvalue()
    assert "0/3 [" in err.getvalue()
    assert err.getvalue().endswith("\r")
    assert err.getvalue().split("\r")[-2].strip() == ""


def test_a_bar_of_bytes_that_goes_on(monkeypatch):
    err = as_stderr(monkeypatch, terminal=True)
    with progress(desc="kitti.zip", unit="B", total=8e6, initial=2_000_000, delay=0):
        assert "25%" in err.getvalue()
        assert "2.00M/8.00M [" in err.getvalue()


@pytest.mark.parametrize("terminal", [False, True])
def test_one_use_whatever_the_stream(monkeypatch, terminal):
    err = as_stderr(monkeypatch, terminal)
    assert list(progress([1, 2], desc="a", unit="b")) == [1, 2]
    with progress(desc="a", unit="B", total=3, initial=1) as shown:
        shown.update()
        shown.update(2)
        shown.total = (shown.total or 0) + 4
        assert shown.total == 7
    shown.close()
    assert err.getvalue() == ""


@pytest.mark.parametrize("terminal", [False, True])
def test_errors_pass_through(monkeypatch, terminal):
    as_stderr(monkeypatch, terminal)
    with pytest.raises(ValueError, match="mine"), progress(desc="a", unit="b"):
        raise ValueError("mine")


def due(waits: Iterable[float]) -> list[bool]:
    """Whether a line is written after each wait; the first is due after one second, others five after the last."""
    clock, stream = Clock(), Stream(terminal=False)
    lines, written = ProgressLines(delay=1, seconds=5, file=stream, clock=clock), []
    for wait in waits:
        clock.now += wait
        before = len(stream.lines)
        lines.update(0)
        written.append(len(stream.lines) > before)
    return written


def test_lines_are_due_by_the_clock():
    assert [when for when, yes in enumerate(due([0, *[1] * 13])) if yes] == [1, 6, 11]


def test_a_late_line_delays_the_next():
    assert due((13, 3, 2, 4)) == [True, False, True, False]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (599, "599 s"), (600, "10 min"), (10799, "180 min"), (10800, "3.0 h")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_time_left():
    assert time_left(done=2, rest=6, elapsed=10) == "30 s left"
    assert time_left(done=0, rest=6, elapsed=10) == "time left unknown"


def test_it_does_not_load_torch():
    code = "import sys, sips_lit.progress; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_bar_of_the_package_is_made_here():
    package = Path(sips_lit.progress.__file__).parent
    with_bars = [
        path.relative_to(package) for path in package.rglob("*.py") if re.search(r"\btqdm( if|\()", path.read_text())
    ]
    assert with_bars == [Path("progress.py")]


def test_warnings_among_the_lines(monkeypatch):
    """What is written meanwhile (by `tqdm.write`) takes no line away and adds none."""
    err = as_stderr(monkeypatch, terminal=False)
    with progress(desc="index", unit="frame", total=3, delay=0) as shown:
        shown.update()
        tqdm.write("warning: one is damaged", file=err)
        shown.update()
    assert [line.partition(",")[0] for line in err.lines] == ["index: 1/3 frames (33 %)", "warning: one is damaged"]
