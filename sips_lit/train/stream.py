"""Items of a dataset in order, from loading workers that are replaced when they hang."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Sequence
from functools import partial
from multiprocessing import connection
from multiprocessing.util import Finalize
from typing import Any, Protocol, cast

import cv2
import torch
import torch.multiprocessing as mp
from torch import distributed
from torch._C import _remove_worker_pids
from torch.utils.data import DataLoader, Subset

from sips_lit.errors import BadInputError, warn_input

LOADING_TIMEOUT = 120.0  # seconds
SECONDS_TO_END = 2.0  # of a loading worker that was killed


class Items(Protocol):
    """A dataset whose items have names, which can be told without reading them; ``what`` is one of them in words."""

    what: str

    def name(self, index: int) -> str:
        """What item ``index`` is called."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Any: ...


def loaded(items: Items, indices: Sequence[int], workers: int, timeout: float) -> Generator[Any]:
    """Some items in order; without ``workers`` from this process.

    Workers that give nothing for ``timeout`` seconds are replaced. Raises BadInputError when the new ones give nothing,
    either.
    """
    at, hung_at = 0, -1
    stream = _Stream(items, indices, workers)
    try:
        while at < len(indices):
            try:
                item = stream.next(timeout)
            except WorkersHung:
                late = f"no {items.what} came for {timeout:g} s (the next is {items.name(indices[at])})"
                if hung_at == at:
                    raise BadInputError(
                        f"{late}, from new loading workers, either: see whether its files can be read, or raise "
                        "datamodule.loading_timeout (seconds)"
                    ) from None
                warn_input(f"{late}: the loading workers hang and are replaced")
                stream.close()
                hung_at, stream = at, _Stream(items, indices[at:], workers, yielding=False)
                continue
            at += 1
            yield item
    finally:
        stream.close()


def of_all_processes(own: dict[str, Any]) -> list[dict[str, Any]]:
    """What every process of a distributed run has, in their order."""
    if not (distributed.is_available() and distributed.is_initialized()):
        return [own]
    states: list[dict[str, Any]] = [{}] * distributed.get_world_size()
    distributed.all_gather_object(states, own)
    return states


class WorkersHung(Exception):  # noqa: N818 - the loader mends it, once
    """Loading workers gave nothing for too long, and were killed."""


class _Stream:
    """Some items, from loading workers that end with it whatever they hang in.

    ``yielding``: whether the workers run only where a core is idle; else a busy machine can't starve them.
    """

    def __init__(self, items: Items, indices: Sequence[int], workers: int, yielding: bool = True) -> None:
        others = mp.active_children()
        initialise = partial(_quiet_worker, yielding)
        loader: DataLoader[Any] = DataLoader(
            Subset(items, indices),  # type: ignore[arg-type]  # a dataset by what it does
            batch_size=None,
            num_workers=workers,
            worker_init_fn=initialise,
            multiprocessing_context=_context(workers),
        )
        self._items: Any = iter(loader)
        self._workers = [child for child in mp.active_children() if child not in others]
        if self._workers:
            # with no end of the pipe left here, what is read from it ends with the workers, in the middle of an item, too
            cast(Any, self._items)._worker_result_queue._writer.close()
        self._end = Finalize(self, _end, (self._items, self._workers), exitpriority=0)

    def next(self, timeout: float) -> Any:
        """What comes next.

        Raises WorkersHung after ``timeout`` seconds, and RuntimeError for a worker that died, as the DataLoader does; if
        its pixels were just being fetched, too. A worker that hangs can block that: the DataLoader's own timeout
        would not notice.
        """
        hung = threading.Event()
        watchdog = threading.Timer(timeout, self._kill, [hung])
        if self._workers:
            watchdog.start()
        try:
            return self._fetch()
        except RuntimeError as error:
            if hung.is_set():
                raise WorkersHung from error
            raise
        finally:
            watchdog.cancel()

    def _fetch(self) -> Any:
        try:
            return next(self._items)
        except (EOFError, OSError) as error:
            if getattr(error, "errno", None) is not None and not isinstance(error, ConnectionError):
                raise
            for worker in self._workers:
                worker.join(1)  # the DataLoader raises its own error as soon as the system tells it, at the latest here
            raise RuntimeError("a DataLoader worker that was read from exited unexpectedly") from error

    def close(self) -> None:
        """Kills the workers, which have nothing to lose; where nobody does this, it is done when the process ends."""
        self._end()

    def _kill(self, noted: threading.Event) -> None:
        noted.set()
        _kill(self._workers)


def _end(items: Any, workers: Sequence[multiprocessing.process.BaseProcess]) -> None:
    """Kills the workers of a DataLoader's iterator.

    Its own way takes turns with them in a lock, for which it would wait for ever if one that starves is killed while it
    holds it. And what Python does with those that are left when a process ends, to ask and to wait, never ends where the
    request falls together with a scheduler's: a signal that comes twice at once comes once.
    """
    if workers and not items._shutdown:
        items._shutdown = True  # for the DataLoader, which else does it its way when it is deleted
        _remove_worker_pids(id(items))  # else it takes those that are killed for a failure
        items._worker_pids_set = False
        _kill(workers)
        for queue in items._index_queues:
            queue.cancel_join_thread()
            queue.close()
    for worker in workers:
        _settle(worker)


def _kill(workers: Sequence[multiprocessing.process.BaseProcess]) -> None:
    for worker in workers:
        if hasattr(os, "SCHED_OTHER"):
            with contextlib.suppress(OSError):  # one that runs only where a core is idle would die only then
                os.sched_setscheduler(worker.pid or 0, os.SCHED_OTHER, os.sched_param(0))
        worker.kill()


def _settle(worker: multiprocessing.process.BaseProcess) -> None:
    """Notes that a worker has ended where its exit code was lost; else it would count as alive for ever.

    The DataLoader's handler of SIGCHLD raises wherever the main thread is, and so between the moment in which the system
    gives away the exit code, once, and that in which Python keeps it.
    """
    worker.join(SECONDS_TO_END)
    if worker.exitcode is None and connection.wait([worker.sentinel], 0):
        worker._popen.returncode = -signal.SIGKILL  # type: ignore[attr-defined]  # as those that are killed


def step_back() -> None:
    """Lets the calling thread run only where a core is idle, on systems that can (Linux).

    The network's threads wait for each other in every layer: one that has to share its core delays them all. Labels fill
    the gaps instead, and at the latest the time in which the network waits for them.
    """
    if hasattr(os, "SCHED_IDLE"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_IDLE, os.sched_param(0))


def _context(workers: int) -> str | None:
    """How workers are started where the default way starts none: in a job of the joblib launcher it is joblib's own."""
    ways = multiprocessing.get_all_start_methods()
    return None if not workers or multiprocessing.get_start_method() in ways else ways[0]


def _quiet_worker(yielding: bool, _: int) -> None:
    """A loading worker leaves the threads to the network, and signals that all processes get to the parent."""
    cv2.setNumThreads(0)  # forked OpenCV threads hang
    torch.set_num_threads(1)
    for name in ("SIGINT", "SIGUSR1", "SIGUSR2"):
        # schedulers warn by the latter two, and a forked worker has the listeners of its parent
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if hasattr(signal, "sigwaitinfo"):  # Linux
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        threading.Thread(target=_end_for_parent, args=(os.getppid(),), daemon=True).start()
    if yielding:
        step_back()


def _end_for_parent(parent: int) -> None:
    """Ends the process when its parent asks for it, and not when a scheduler asks the whole group."""
    while signal.sigwaitinfo({signal.SIGTERM}).si_pid != parent:
        pass
    os._exit(0)
