import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import torch.multiprocessing as mp

from sips_lit.errors import BadInputError
from sips_lit.train.stream import _quiet_worker, _Stream, loaded, of_all_processes


class Squares:
    """Items that are the squares of their indices; one of them may hang."""

    what = "square"

    def __init__(self, length: int, hangs_at: int | None = None) -> None:
        self.length, self.hangs_at = length, hangs_at

    def name(self, index: int) -> str:
        return f"that of {index}"

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> int:
        if index == self.hangs_at:
            signal.pause()
        return index * index


@pytest.mark.parametrize("workers", [0, 2])
def test_the_items_of_some_indices_come_in_order(workers):
    assert list(loaded(Squares(20), range(3, 20, 4), workers, 30)) == [9, 49, 121, 225, 361]
    assert list(loaded(Squares(20), range(0), workers, 30)) == []
    assert mp.active_children() == []


@pytest.mark.filterwarnings("ignore:no square came")
def test_an_item_that_never_comes_is_told_by_its_name():
    squares = loaded(Squares(20, hangs_at=4), range(0, 20, 2), 1, 3.0)
    assert [next(squares), next(squares)] == [0, 4]
    told = r"no square came for 3 s \(the next is that of 4\), from new loading workers"
    with pytest.raises(BadInputError, match=told):
        next(squares)
    assert mp.active_children() == []


def test_workers_that_were_killed_with_a_lock_do_not_keep_the_stream_from_closing():
    """As one is that starves: it is taken off the processor while it looks whether it is to end."""
    stream = _Stream(Squares(100), range(100), workers=2)
    assert stream.next(30) == 0
    stream._items._workers_done_event._cond.acquire()  # nobody gives it back
    closing = threading.Thread(target=stream.close, daemon=True)
    closing.start()
    closing.join(20)
    assert not closing.is_alive()
    assert mp.active_children() == []


def test_a_stream_that_is_left_early_closes_at_once():
    squares = loaded(Squares(100, hangs_at=5), range(100), 2, 30)
    assert next(squares) == 0
    start = time.monotonic()
    squares.close()
    assert time.monotonic() - start < 1.5  # those that hang were waited for 2 s
    assert mp.active_children() == []


ENDS_WITHOUT_CLOSING = """
import os, signal, sys
from sips_lit.train import stream
class Ones:
    what = "one"
    def __len__(self): return 100
    def __getitem__(self, index): return 1
stream._end_for_parent = lambda parent: signal.pause()
def main():
    left = stream.loaded(Ones(), range(100), 2, 30)
    print(next(left), flush=True)
    sys.left = left
if sys.argv[1] == "process":
    import multiprocessing
    child = multiprocessing.get_context("fork").Process(target=main)
    child.start()
    child.join()
else:
    main()
"""


@pytest.mark.parametrize("way", ["interpreter", "process"])
def test_a_process_ends_though_its_workers_do_not_hear_that_it_asks_them_to(way):
    """Two signals at once come as one, and that one as from a scheduler: `multiprocessing` would wait for ever."""
    code = [sys.executable, "-c", ENDS_WITHOUT_CLOSING, way]
    ended = subprocess.run(code, timeout=40, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, "1\n"), ended.stderr


class Box:
    """An array that passes through the pipe: only bare ones become tensors."""

    def __init__(self) -> None:
        self.array = np.zeros(3_000_000, np.uint8)


class Boxes(Squares):
    """Items larger than a pipe."""

    def __getitem__(self, index: int) -> Box:
        return Box()


def kill_and(go_on: Callable[[], object], children: Sequence[multiprocessing.process.BaseProcess]) -> None:
    for child in children:
        if hasattr(os, "SCHED_OTHER"):  # else it dies only where a core is idle
            os.sched_setscheduler(child.pid, os.SCHED_OTHER, os.sched_param(0))
        os.kill(child.pid, signal.SIGKILL)
    go_on()


def interrupt(*_: object) -> None:
    raise TimeoutError


@pytest.fixture
def no_signal() -> Iterator[Callable[[], object]]:
    """``no_signal()``: the DataLoader hears of no worker's end, as where workers are started by a server of forks.

    SIGALRM interrupts what waits.
    """
    before = signal.getsignal(signal.SIGCHLD)
    alarm = signal.signal(signal.SIGALRM, interrupt)
    yield lambda: signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, before)
    signal.signal(signal.SIGALRM, alarm)


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("items", [Squares, Boxes])
def test_workers_that_are_killed_end_the_stream(items, heard, no_signal):
    """Workers with large items die in the middle of one, and nothing comes from the pipe any more."""
    stream = loaded(items(200), range(200), 2, 30)
    next(stream)
    children = mp.active_children()
    assert len(children) == 2
    time.sleep(0.3)
    if not heard:
        no_signal()
    began = time.monotonic()
    signal.alarm(60)  # interrupts a read that never ends
    with pytest.raises(RuntimeError, match=r"DataLoader worker .* (killed by signal|exited unexpectedly)"):
        kill_and(lambda: list(stream), children)
    signal.alarm(0)
    assert time.monotonic() - began < 50
    stream.close()
    assert mp.active_children() == []


@pytest.mark.skipif(multiprocessing.get_start_method() != "fork", reason="else workers are no children of this process")
def test_a_worker_whose_exit_code_was_lost_does_not_count_as_alive():
    """As where the DataLoader's handler raises when the code is just there."""
    stream = loaded(Squares(200), range(200), 1, 30)
    next(stream)
    (child,) = mp.active_children()
    with pytest.raises(RuntimeError, match="killed by signal"):
        kill_and(lambda: time.sleep(60), [child])
    with contextlib.suppress(ChildProcessError):
        os.waitpid(child.pid, 0)
    assert mp.active_children() == [child]
    stream.close()
    assert mp.active_children() == []


def test_one_process_has_its_own_state_only():
    assert of_all_processes({"a": 1}) == [{"a": 1}]


def work(ready) -> None:
    _quiet_worker(True, 0)
    ready.set()
    time.sleep(30)


@pytest.mark.skipif(not hasattr(signal, "sigwaitinfo"), reason="the sender of a signal is known on Linux only")
def test_a_worker_ends_when_its_parent_asks_and_not_with_the_whole_group():
    context = multiprocessing.get_context("fork")
    ready = context.Event()
    worker = context.Process(target=work, args=(ready,))
    worker.start()
    assert ready.wait(20)
    for name in ("SIGTERM", "SIGINT", "SIGUSR1", "SIGUSR2"):
        send = f"import os, signal; os.kill({worker.pid}, signal.{name})"
        subprocess.run([sys.executable, "-c", send], check=True)
    time.sleep(0.3)
    assert worker.is_alive()
    worker.terminate()
    worker.join(10)
    assert worker.exitcode == 0


def test_a_program_that_ends_between_two_items_ends():
    """The stream ends with the interpreter then, which starts no threads any more."""
    script = f"import sys; sys.path[:0] = {sys.path!r} + [{str(Path(__file__).parent)!r}]\n" + (
        "from test_stream import Squares, loaded\nstream = loaded(Squares(20), range(20), 2, 30)\nnext(stream)\nsys.exit(1)"
    )
    assert subprocess.run([sys.executable, "-c", script], timeout=60, capture_output=True).returncode == 1
