"""SIGTERM and readers that leave: a command cleans up and ends with the exit code that a shell expects."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Never

from sips_lit.errors import TrainingInterrupted

INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM  # as a shell has it


@contextmanager
def signals_heard() -> Iterator[None]:
    """Makes SIGTERM an exit, which cleans up; gives the signals back as they were, whatever a training made of them.

    After a stop by a signal SIGTERM stays ignored: the program ends anyway, and schedulers send it twice.
    """
    if threading.current_thread() is not threading.main_thread():  # only there can it be
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except BaseException as error:
        if isinstance(error, TrainingInterrupted) or (isinstance(error, SystemExit) and error.code == TERMINATED):
            before[signal.SIGTERM] = signal.SIG_IGN
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _terminate(number: int, frame: FrameType | None) -> None:
    from hydra.core.hydra_config import HydraConfig  # here: --help does not wait for Hydra

    signal.signal(number, signal.SIG_IGN)
    if HydraConfig.initialized() and HydraConfig.get().job.name.startswith("train_ddp_process_"):
        os.kill(os.getppid(), number)  # of several processes of a training: the one that launched this ends all
    else:
        sys.exit(128 + number)


def leave_pipe() -> Never:
    """Ends without a word, as others do whose reader has seen enough (``| head``)."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is flushed at the end
    sys.exit(128 + signal.SIGPIPE)
