"""Where the time of a training step goes, and what would make it shorter."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final

WORKERS: Final = ("decode", "describe", "match", "track")
"""Stages beside the network: reading and augmenting frames in loading workers, the others in labelling threads."""
STEP: Final = ("select", "forward", "backward", "wait_decode", "wait_labels")
"""Stages one after another, which make up a step: ``backward`` has the optimiser's step in it, too."""
WAITS: Final = 0.1
"""Share of a step in waiting from which on it pays to do something about it (our choice)."""


class Stopwatch:
    """Adds up seconds by stage; of one thread. ``clock`` gives seconds."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.seconds: dict[str, float] = {}
        self.clock = clock

    @contextlib.contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Adds the time that the block takes."""
        start = self.clock()
        try:
            yield
        finally:
            self.add(stage, self.clock() - start)

    def add(self, stage: str, seconds: float) -> None:
        """Adds seconds."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds


def in_words(seconds: Mapping[str, float], loading_workers: int, labelling_workers: int, cores: int) -> str:
    """One line: mean seconds of a pair by stage, as shares of the step, and advice."""
    step = sum(seconds.get(stage, 0.0) for stage in STEP)
    shares = sorted(((seconds.get(stage, 0.0) / step, stage) for stage in STEP), reverse=True) if step else []
    names = {"wait_decode": "waiting for frames", "wait_labels": "waiting for labels"}
    told = ", ".join(f"{names.get(stage, stage)} {share:.0%}" for share, stage in shares if share >= 0.01)
    return f"{1000 * step:.0f} ms a pair ({told}): {advice(seconds, loading_workers, labelling_workers, cores)}"


def advice(seconds: Mapping[str, float], loading_workers: int, labelling_workers: int, cores: int) -> str:
    """What a step's time says to do, from mean seconds of a pair by stage.

    More workers are advised as long as there are cores for them; then what they do has to become less.
    """
    step = sum(seconds.get(stage, 0.0) for stage in STEP)
    frames, labels = seconds.get("wait_decode", 0.0), seconds.get("wait_labels", 0.0)
    if frames + labels < WAITS * step or not step:
        return "the network is the limit: a smaller model, fewer module.points or a GPU would be faster"
    if frames >= labels:
        who = "labels wait" if labelling_workers else "the network waits"
        if loading_workers < cores:
            now = "none: the network reads them itself" if not loading_workers else str(loading_workers)
            return f"{who} for decoding: more datamodule.loading_workers (now {now})"
        return f"{who} for decoding, and all {cores} cores decode: make frames smaller, or decode them beforehand"
    stages = {stage: seconds.get(stage, 0.0) for stage in WORKERS[1:]}
    most = max(stages, key=stages.__getitem__)
    part = f"{most} is {stages[most] / max(sum(stages.values()), 1e-9):.0%} of it"
    if labelling_workers < cores:
        return f"the network waits for labels ({part}): more datamodule.labelling_workers (now {labelling_workers})"
    return f"the network waits for labels ({part}), and all {cores} cores label: fewer module.points, or more cores"
