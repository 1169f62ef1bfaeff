"""Wall time of a training step of `small` against max(network alone, labelling alone / workers); both gradient routes."""

from __future__ import annotations

import sips_lit.cli  # noqa: F401 - first: it sets how OpenMP threads wait

# isort: split

import tempfile
import time
from collections.abc import Callable
from functools import partial

import cv2
import lightning as L
import numpy as np
import torch
from frames_to_use import Film, frames_from_arguments

from sips_lit.cli.app import fast_precision
from sips_lit.describe.sift import RootSift
from sips_lit.detect.score_network import Gradient, ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor, logits_at
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import Augmentation
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.labelling import label_pair
from sips_lit.train.module import SipsModule

WORKERS, POINTS, STEPS = 2, 500, 40


class StepClock(L.Callback):
    """When each step ended."""

    def __init__(self) -> None:
        self.ends: list[float] = []

    def on_train_batch_end(self, *_: object) -> None:
        self.ends.append(time.perf_counter())


def median_time(function: Callable[[int], object], repeats: int) -> float:
    function(0)
    times = []
    for index in range(repeats):
        start = time.perf_counter()
        function(index)
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def network_time(network: ScoreNetwork, film: Film, gradient: Gradient, repeats: int) -> float:
    """Selecting points in two images, and forward, backward and optimiser at those points."""
    selector, optimizer = PointSelector(), torch.optim.Adam(network.parameters(), 3e-4)
    images = [image_tensor(film.frames[0]), image_tensor(film.frames[-1])]
    autocast = torch.autocast("cpu", torch.bfloat16, enabled=fast_precision() == "bf16-mixed")

    def step(_: int) -> None:
        with autocast:
            points = [selector.select(network, image, POINTS) for image in images]
            logits = logits_at(network, images, points, gradient)
            loss = torch.nn.functional.softplus(torch.cat(logits)).sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    return median_time(step, repeats)


def labelling_time(network: ScoreNetwork, film: Film, pairs: list[tuple[int, int]]) -> float:
    """Descriptors, matches and tracks of the pairs that the training draws, one thread."""
    selector, descriptor, check = PointSelector(), RootSift(), RetracedKltInliers()
    prepared = []
    for first, second in pairs:
        pair = read_pair(film, first, second)
        points = [selector.select(network, image_tensor(i), POINTS).keypoints for i in (pair.image0, pair.image1)]
        prepared.append((pair, *points))
    start = time.perf_counter()
    for pair, keypoints0, keypoints1 in prepared:
        label_pair(pair, keypoints0, keypoints1, descriptor, check)
    return (time.perf_counter() - start) / len(prepared)


def main() -> None:
    film = frames_from_arguments(__doc__ or "")
    cv2.setNumThreads(1)
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as folder:
        data = PairDataModule(
            [film],
            RootSift(),
            RetracedKltInliers(),
            folder,
            [film],
            Augmentation(),
            loading_workers=2,
            labelling_workers=WORKERS,
        )
        module = SipsModule(ScoreNetwork(), PointSelector(), partial(torch.optim.Adam, lr=3e-4), points=POINTS)
        clock = StepClock()
        trainer = L.Trainer(
            max_steps=STEPS,
            callbacks=[clock],
            precision=fast_precision(),
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            limit_val_batches=0,
        )
        trainer.fit(module, data)
        draws = [data.sampler.draw(0, index)[1] for index in range(STEPS)]
    wall = float(np.mean(np.diff(clock.ends)[5:]))
    network = module.network
    patches, dense = network_time(network, film, "patches", 10), network_time(network, film, "dense", 3)
    labels = labelling_time(network, film, [(draw.index0, draw.index1) for draw in draws])
    limit = max(min(patches, dense), labels / WORKERS)
    print(
        f"precision {fast_precision()}, {torch.get_num_threads()} threads, {WORKERS} labelling workers, {POINTS} points"
    )
    print(
        f"network alone: {patches * 1e3:.0f} ms by patches, {dense * 1e3:.0f} ms dense; labelling: {labels * 1e3:.0f} ms"
    )
    print(
        f"training step: {wall * 1e3:.0f} ms = {wall / limit:.2f} x max(network, labelling / workers) (wanted: at most 1.15)"
    )


if __name__ == "__main__":
    main()
