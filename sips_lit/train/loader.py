"""Labels one step ahead: while the optimiser works on pair t, the points of pair t + 1 are selected and labelled."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import torch
import torch.multiprocessing as mp
from torch import Tensor, distributed
from torch._C import _remove_worker_pids
from torch.utils.data import DataLoader, Subset

from sips_lit.detect.selection import SelectedPoints, image_tensor
from sips_lit.errors import BadInputError, warn_input
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.match.mutual_nearest import MutualLifetimes
from sips_lit.pairs.sampler import SourcePair
from sips_lit.train.dataset import PackedPairs, SkippedPairs, unpack
from sips_lit.train.labelling import images_between, label_along, label_pair
from sips_lit.types import Descriptor, GreyImage, InlierCheck, Keypoints

LOADING_TIMEOUT = 120.0  # seconds
SECONDS_TO_END = 2.0  # of a loading worker whose pairs nobody wants any more


@dataclass(frozen=True, slots=True)
class LabelledPair:
    """What a training step needs: both images (1, 1, H, W) float, points, labels, inlier matches, where the pair is from.

    ``skipped``: how many pairs the run left out so far because they can't be read.
    """

    image0: Tensor
    image1: Tensor
    points0: SelectedPoints
    points1: SelectedPoints
    labels0: PointLabels
    labels1: PointLabels
    inliers: MutualLifetimes
    source: int
    name: str
    skipped: int = 0

    def to(self, device: torch.device) -> LabelledPair:
        """The same with its images on a device; points and labels stay where they are small and used."""
        return replace(self, image0=self.image0.to(device), image1=self.image1.to(device))


Points = tuple[SelectedPoints, ...]
"""Of image 0, of image 1, and of the frames between in which points are looked for again."""


class OneStepAhead:
    """Yields pairs labelled by the network as it was one optimiser step earlier, whatever the timing.

    Asks ``select`` for the points of the next pair, hands them to ``workers`` labelling threads (OpenCV releases the
    GIL), and yields the pair labelled before. The state is the position in the stream of pairs and the points of the
    pair that is being labelled: with it a resumed run continues as if it had not been interrupted. ``skipped`` counts
    the pairs that can't be read. ``budgets``: see `label_pair`; ``between``: in how many frames between, at most, points are
    looked for again (`label_along`), where the check uses these. Loading workers that give no pair for
    ``loading_timeout`` seconds are replaced.
    """

    def __init__(
        self,
        pairs: PackedPairs,
        select: Callable[[GreyImage], SelectedPoints],
        descriptor: Descriptor,
        checks: Sequence[InlierCheck],
        loading_workers: int,
        labelling_workers: int,
        first: int = 0,
        stride: int = 1,
        skipped: SkippedPairs | None = None,
        loading_timeout: float = LOADING_TIMEOUT,
        budgets: Sequence[int] = (),
        between: int = 0,
    ) -> None:
        self.budgets, self.between = budgets, between
        self.skipped, self.loading_timeout = skipped or SkippedPairs(), loading_timeout
        self.pairs, self.select, self.descriptor, self.checks = pairs, select, descriptor, checks
        self.loading_workers, self.labelling_workers = loading_workers, max(1, labelling_workers)
        self.first, self.indices = first, range(first, len(pairs), stride)  # of the pairs that this process takes
        self.position = 0
        self._ahead: Points | None = None

    def __len__(self) -> int:
        """Pairs in the whole stream: independent of the position, as Lightning counts batches from the start."""
        return len(self.indices)

    def __iter__(self) -> Iterator[LabelledPair]:
        """Continues at ``position``. Raises BadInputError when the workers that replace others give no pair, either."""
        # closed here, not when nobody refers to it any more: an error refers to all that it went through
        with (
            contextlib.closing(self._packed()) as stream,
            _pool(1) as coordinator,
            _pool(self.labelling_workers) as workers,
        ):

            def submit(ahead: Points | None = None) -> tuple[Points, tuple[str, ...], Future[LabelledPair]] | None:
                packed = next(stream, None)
                if packed is None:
                    return None
                item = unpack(packed)
                points = ahead or self._select(item)
                return points, item.skipped, coordinator.submit(self._label, item, points, workers)

            labelling = submit(self._ahead)
            while labelling is not None:
                following = submit()
                labelled = labelling[2].result()
                self.position += 1
                self.skipped.add(labelling[1], self.position)
                self._ahead = following[0] if following else None
                yield replace(labelled, skipped=self.skipped.count)
                labelling = following

    def _packed(self) -> Generator[Any]:
        """The pairs from ``position`` on, as `PackedPairs` has them."""
        at, hung_at = self.position, -1
        stream = _Stream(self.pairs, self.indices[at:], self.loading_workers)
        try:
            while True:
                try:
                    packed = stream.next(self.loading_timeout)
                except WorkersHung:
                    name = self.pairs.name(self.indices[at])
                    late = f"no training pair came for {self.loading_timeout:g} s (the next is {name})"
                    if hung_at == at:
                        raise BadInputError(
                            f"{late}, from new loading workers, either: see whether its files can be read, or raise "
                            "datamodule.loading_timeout (seconds)"
                        ) from None
                    warn_input(f"{late}: the loading workers hang and are replaced")
                    stream.close()
                    hung_at, stream = at, _Stream(self.pairs, self.indices[at:], self.loading_workers, yielding=False)
                    continue
                if packed is None:
                    return
                at += 1
                yield packed
        finally:
            stream.close()

    def _select(self, item: SourcePair) -> Points:
        return tuple(map(self.select, (item.pair.image0, item.pair.image1, *self._images_between(item).values())))

    def _images_between(self, item: SourcePair) -> dict[int, GreyImage]:
        return images_between(item.pair, self.between) if self.checks[item.source].uses_frames else {}

    def _label(self, item: SourcePair, points: Points, workers: ThreadPoolExecutor) -> LabelledPair:
        pair, check = item.pair, self.checks[item.source]
        keypoints0, keypoints1, *others = (selected.keypoints for selected in points)
        images = self._images_between(item)
        between = dict(zip(images, zip(images.values(), others, strict=True), strict=True))
        label = partial(
            label_pair,
            descriptor=self.descriptor,
            check=check,
            parallel=workers.map,
            parts=self.labelling_workers,
            budgets=self.budgets,
        )
        labels0, labels1, inliers = label_along(pair, keypoints0, keypoints1, between, label)
        ends = image_tensor(pair.image0), image_tensor(pair.image1)
        return LabelledPair(*ends, points[0], points[1], labels0, labels1, inliers, item.source, pair.name)

    def state_dict(self) -> dict[str, Any]:
        """Plain numbers and tensors, as a checkpoint may hold, of all processes: each has pairs of its own."""
        ahead = [_to_state(points) for points in self._ahead or ()]
        own = {"ahead": ahead, "skipped": self.skipped.state_dict()}
        return {"position": self.position, "processes": _of_all_processes(own)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue where the state was taken; with another number of processes at the same place of the stream."""
        states = state["processes"]
        self.position = state["position"] * len(states) // self.indices.step
        own = states[self.indices.start] if len(states) == self.indices.step else {**states[0], "ahead": []}
        self.skipped.load_state_dict(own["skipped"])
        self._ahead = tuple(map(_from_state, own["ahead"])) or None


def _of_all_processes(own: dict[str, Any]) -> list[dict[str, Any]]:
    """What every process of a distributed run has, in their order."""
    if not (distributed.is_available() and distributed.is_initialized()):
        return [own]
    states: list[dict[str, Any]] = [{}] * distributed.get_world_size()
    distributed.all_gather_object(states, own)
    return states


class WorkersHung(Exception):  # noqa: N818 - the loader mends it, once
    """Loading workers gave nothing for too long, and were killed."""


class _Stream:
    """The packed pairs of some indices, from loading workers that end with it whatever they hang in.

    ``yielding``: whether the workers run only where a core is idle; else a busy machine can't starve them.
    """

    def __init__(self, pairs: PackedPairs, indices: Sequence[int], workers: int, yielding: bool = True) -> None:
        others = mp.active_children()
        initialise = partial(_quiet_worker, yielding)
        loader = DataLoader(
            Subset(pairs, indices),
            batch_size=None,
            num_workers=workers,
            worker_init_fn=initialise,
            multiprocessing_context=_context(workers),
        )
        self._pairs: Any = iter(loader)
        self._workers = [child for child in mp.active_children() if child not in others]

    def next(self, timeout: float) -> Any:
        """What comes next, None at the end.

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
            return next(self._pairs, None)
        except (EOFError, ConnectionError) as error:
            for worker in self._workers:
                worker.join(1)  # the DataLoader raises its own error as soon as the system tells it, at the latest here
            raise RuntimeError("a DataLoader worker that was read from exited unexpectedly") from error

    def close(self) -> None:
        """Ends the workers, by force if they do not end soon."""
        if self._workers and not self._pairs._shutdown:
            _remove_worker_pids(id(self._pairs))  # else the DataLoader takes those that are killed for a failure
            self._pairs._worker_pids_set = False
            patience = threading.Timer(SECONDS_TO_END, self._kill)
            if sys.is_finalizing():
                self._kill()  # no thread starts any more, and to wait for its start would never end
            else:
                patience.start()
            self._pairs._shutdown_workers()
            patience.cancel()

    def _kill(self, noted: threading.Event | None = None) -> None:
        if noted is not None:
            noted.set()
        for worker in self._workers:
            worker.kill()


def _to_state(points: SelectedPoints) -> dict[str, Tensor]:
    k = points.keypoints
    arrays: dict[str, Any] = {"xy": k.xy, "score": k.score, "scale": k.scale}
    arrays |= {"level": points.level, "row": points.row, "column": points.column}
    return {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}


def _from_state(state: dict[str, Tensor]) -> SelectedPoints:
    a = {name: tensor.numpy() for name, tensor in state.items()}
    return SelectedPoints(Keypoints(a["xy"], a["score"], a["scale"]), a["level"], a["row"], a["column"])


def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, initializer=_step_back)


def _step_back() -> None:
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "sigwaitinfo"):  # Linux
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        threading.Thread(target=_end_for_parent, args=(os.getppid(),), daemon=True).start()
    if yielding:
        _step_back()


def _end_for_parent(parent: int) -> None:
    """Ends the process when its parent asks for it, and not when a scheduler asks the whole group."""
    while signal.sigwaitinfo({signal.SIGTERM}).si_pid != parent:
        pass
    os._exit(0)
