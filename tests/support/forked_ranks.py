"""The processes that Lightning launches beside a training, forked before it begins instead of started anew."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

CONTEXT = multiprocessing.get_context("fork")
LAUNCHER = "lightning.pytorch.strategies.launchers.subprocess_script"


class ForkedRank(CONTEXT.Process):  # type: ignore[name-defined, misc]
    """Waits until it is launched, with what Lightning uses of Popen. Its name among the processes is that of its job."""

    def __init__(self, main: Callable[[], Any]) -> None:
        self.orders, self.give = CONTEXT.Pipe(duplex=False)
        super().__init__(target=self.work, args=(main,))
        self.start()
        self.orders.close()

    def work(self, main: Callable[[], Any]) -> None:
        self.give.close()
        try:
            command, environment, folder = self.orders.recv()
        except EOFError:  # it is not needed
            return
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        sys.argv = command[1:]
        (job,) = (word.partition("=")[2] for word in sys.argv if word.startswith("hydra.job.name="))
        Path("/proc/self/comm").write_text(job[-15:])  # the kernel keeps no more
        main()

    def launch(self, command: Sequence[str], env: Mapping[str, str], cwd: str | None) -> ForkedRank:
        self.give.send((list(command), dict(env), cwd or "."))
        return self

    @property
    def returncode(self) -> int | None:
        return self.exitcode

    def poll(self) -> int | None:
        return self.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self.join(timeout)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired("a rank", timeout or 0)
        return self.exitcode

    def send_signal(self, number: signal.Signals) -> None:
        if self.exitcode is None:
            os.kill(self.pid, number)


@contextmanager
def ranks_ready(count: int, main: Callable[[], Any]) -> Iterator[None]:
    """Lightning launches these processes in here; each runs ``main`` with the arguments that it gets."""
    ranks = [ForkedRank(main) for _ in range(count)]
    waiting = iter(ranks)
    with pytest.MonkeyPatch.context() as patch:
        if ranks:
            forked = SimpleNamespace(Popen=lambda command, env, cwd: next(waiting).launch(command, env, cwd))
            patch.setattr(f"{LAUNCHER}.subprocess", forked)
        try:
            yield
        finally:
            for rank in ranks:
                rank.give.close()
