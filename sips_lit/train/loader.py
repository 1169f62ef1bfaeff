"""Labels one step ahead: while the optimiser works on step t, the points of step t + 1 are selected and labelled."""

from __future__ import annotations

import contextlib
import itertools
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import torch
from threadpoolctl import threadpool_limits
from torch import Tensor

from sips_lit.detect.selection import SelectedPoints, image_tensor
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.matching.mutual_nearest import MutualLifetimes
from sips_lit.pairs.sampler import SourcePair
from sips_lit.train.dataset import PackedPairs, SkippedItems, unpack
from sips_lit.train.labelling import Map, images_between, label_along, label_pair
from sips_lit.train.step_times import Stopwatch
from sips_lit.train.stream import LOADING_TIMEOUT, loaded, of_all_processes, step_back
from sips_lit.types import Descriptor, GreyImage, InlierCheck, Keypoints

MOST_AHEAD = 16
"""Pairs: each holds all frames between its two until it is labelled."""


@dataclass(frozen=True, slots=True)
class LabelledPair:
    """What a training step needs: both images (1, 1, H, W) float, points, labels, inlier matches, where the pair is from.

    ``skipped``: how many pairs the run left out so far because they can't be read; ``seconds``: how long it took by the
    stages of `step_times`, without those of the network, and how long it was waited for.
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
    seconds: dict[str, float] = field(default_factory=dict, compare=False)

    def to(self, device: torch.device) -> LabelledPair:
        """The same with its images on a device; points and labels stay where they are small and used."""
        return replace(self, image0=self.image0.to(device), image1=self.image1.to(device))

    def plain(self) -> dict[str, Any]:
        """As tensors, numbers and strings, which load without running code."""
        plain: dict[str, Any] = {"name": self.name, "image0": self.image0.cpu(), "image1": self.image1.cpu()}
        for side, points, labels in (("0", self.points0, self.labels0), ("1", self.points1, self.labels1)):
            arrays = {**asdict(points.keypoints), "row": points.row, "column": points.column, **asdict(labels)}
            for name, array in arrays.items():
                if array is not None:
                    plain[f"{name}{side}"] = torch.from_numpy(array.copy())
        return plain


Points = tuple[SelectedPoints, ...]
"""Of image 0, of image 1, and of the frames between in which points are looked for again."""


@dataclass(frozen=True, slots=True)
class _Labelling:
    """A pair that is being labelled, the points that it is labelled for, and what was left out before it."""

    points: Points
    skipped: tuple[str, ...]
    pair: Future[LabelledPair]


class OneStepAhead:
    """Yields pairs labelled by the network as it was one optimiser step earlier, whatever the timing.

    Where a step begins, asks ``select`` for the points of the ``pairs_per_step`` pairs of the next step, hands them to
    ``labelling_workers`` threads (OpenCV releases the GIL), and yields those labelled before. It asks image by image, or
    with ``pairs_at_once`` above 1 for all images of so many pairs. So two processes of one pair
    a step see what one process of two sees. Of steps of more than `MOST_AHEAD` pairs so many are selected ahead. The state
    is the position in the stream of pairs and the points of the pairs that are being labelled: with it a resumed run
    continues as if it had not been interrupted. ``skipped`` counts
    the pairs that can't be read. ``budgets``: see `label_pair`; ``between``: in how many frames between, at most, points are
    looked for again (`label_along`), where the check uses these. Loading workers that give no pair for
    ``loading_timeout`` seconds are replaced.
    """

    def __init__(
        self,
        pairs: PackedPairs,
        select: Callable[[Sequence[GreyImage]], list[SelectedPoints]],
        descriptor: Descriptor,
        checks: Sequence[InlierCheck],
        loading_workers: int,
        labelling_workers: int,
        first: int = 0,
        stride: int = 1,
        skipped: SkippedItems | None = None,
        loading_timeout: float = LOADING_TIMEOUT,
        budgets: Sequence[int] = (),
        between: int = 0,
        pairs_per_step: int = 1,
        pairs_at_once: int = 1,
    ) -> None:
        self.pairs_per_step, self.pairs_at_once = min(pairs_per_step, MOST_AHEAD), pairs_at_once
        self.budgets, self.between = budgets, between
        self.skipped, self.loading_timeout = skipped or SkippedItems(), loading_timeout
        self.pairs, self.select, self.descriptor, self.checks = pairs, select, descriptor, checks
        self.loading_workers, self.labelling_workers = loading_workers, max(1, labelling_workers)
        self.first, self.indices = first, range(first, len(pairs), stride)  # of the pairs that this process takes
        self.position = 0
        self._ahead: list[Points] = []

    def __len__(self) -> int:
        """Pairs in the whole stream: independent of the position, as Lightning counts batches from the start."""
        return len(self.indices)

    def __iter__(self) -> Iterator[LabelledPair]:
        """Continues at ``position``. Raises BadInputError when the workers that replace others give no pair, either."""
        # closed here, not when nobody refers to it any more: an error refers to all that it went through
        packed_pairs = loaded(self.pairs, self.indices[self.position :], self.loading_workers, self.loading_timeout)
        at_once = min(self.pairs_per_step, self.labelling_workers)
        with (
            contextlib.closing(packed_pairs) as stream,
            # OpenBLAS's other threads spin for some milliseconds after each product of small arrays
            threadpool_limits(1, user_api="blas"),
            _pool(at_once) as coordinators,
            _pool(self.labelling_workers) as workers,
        ):
            parts = self.labelling_workers // at_once  # of a pair: with more pairs than threads each takes a whole one

            def submitted(count: int, ahead: Sequence[Points] = ()) -> list[_Labelling]:
                drawn = list(itertools.islice(self._drawn(stream), count))
                if not drawn:
                    return []
                selecting = Stopwatch()
                with selecting("select"):
                    points_of = ahead or self._select([item for item, _ in drawn])
                begun = []
                # a stream may end before what is ahead
                for (item, watch), points in zip(drawn, points_of, strict=False):
                    watch.add("select", selecting.seconds["select"] / len(drawn))
                    label = partial(self._label, item, points, workers.map if parts > 1 else map, parts, watch)
                    begun.append(_Labelling(points, item.skipped, coordinators.submit(label)))
                return begun

            labelling = deque(submitted(len(self._ahead), self._ahead))
            while True:
                if self.position % self.pairs_per_step == 0 or not labelling:
                    while (missing := 2 * self.pairs_per_step - len(labelling)) > 0:
                        following = submitted(min(missing, self.pairs_at_once))
                        if not following:
                            break
                        labelling.extend(following)
                if not labelling:
                    return
                first = labelling.popleft()
                waiting = Stopwatch()
                with waiting("wait_labels"):
                    labelled = first.pair.result()
                self.position += 1
                self.skipped.add(first.skipped, self.position)
                self._ahead = [pair.points for pair in labelling]
                yield replace(labelled, skipped=self.skipped.count, seconds=labelled.seconds | waiting.seconds)

    @staticmethod
    def _drawn(stream: Iterator[Any]) -> Iterator[tuple[SourcePair, Stopwatch]]:
        while True:
            watch = Stopwatch()
            with watch("wait_decode"):
                packed = next(stream, None)
            if packed is None:
                return
            item = unpack(packed)
            watch.add("decode", packed["seconds"])
            yield item, watch

    def _select(self, items: Sequence[SourcePair]) -> list[Points]:
        images = [[item.pair.image0, item.pair.image1, *self._images_between(item).values()] for item in items]
        every = list(itertools.chain.from_iterable(images))
        selected = self.select(every) if self.pairs_at_once > 1 else [self.select([image])[0] for image in every]
        rest = iter(selected)
        return [tuple(itertools.islice(rest, len(of_pair))) for of_pair in images]

    def _images_between(self, item: SourcePair) -> dict[int, GreyImage]:
        return images_between(item.pair, self.between) if self.checks[item.source].uses_frames else {}

    def _label(self, item: SourcePair, points: Points, parallel: Map, parts: int, watch: Stopwatch) -> LabelledPair:
        pair, check = item.pair, self.checks[item.source]
        keypoints0, keypoints1, *others = (selected.keypoints for selected in points)
        images = self._images_between(item)
        between = dict(zip(images, zip(images.values(), others, strict=True), strict=True))
        label = partial(
            label_pair,
            descriptor=self.descriptor,
            check=check,
            parallel=parallel,
            parts=parts,
            budgets=self.budgets,
            watch=watch,
        )
        labels0, labels1, inliers = label_along(pair, keypoints0, keypoints1, between, label)
        ends = image_tensor(pair.image0), image_tensor(pair.image1)
        labelled = LabelledPair(*ends, points[0], points[1], labels0, labels1, inliers, item.source, pair.name)
        return replace(labelled, seconds=watch.seconds)

    def state_dict(self) -> dict[str, Any]:
        """Plain numbers and tensors, as a checkpoint may hold, of all processes: each has pairs of its own."""
        ahead = [list(map(_to_state, points)) for points in self._ahead]
        own = {"ahead": ahead, "skipped": self.skipped.state_dict()}
        return {"position": self.position, "processes": of_all_processes(own)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue where the state was taken; with another number of processes at the same place of the stream."""
        states = state["processes"]
        self.position = state["position"] * len(states) // self.indices.step
        own = states[self.indices.start] if len(states) == self.indices.step else {**states[0], "ahead": []}
        self.skipped.load_state_dict(own["skipped"])
        self._ahead = [tuple(map(_from_state, points)) for points in own["ahead"]]


def _to_state(points: SelectedPoints) -> dict[str, Tensor]:
    k = points.keypoints
    arrays: dict[str, Any] = {"xy": k.xy, "score": k.score, "scale": k.scale}
    arrays |= {"level": points.level, "row": points.row, "column": points.column}
    return {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}


def _from_state(state: dict[str, Tensor]) -> SelectedPoints:
    a = {name: tensor.numpy() for name, tensor in state.items()}
    return SelectedPoints(Keypoints(a["xy"], a["score"], a["scale"]), a["level"], a["row"], a["column"])


def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, initializer=step_back)
