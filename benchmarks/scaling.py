"""What a labelled pair costs, what frames take on the disk, and how far a simple model predicts pairs per second.

python benchmarks/scaling.py [VIDEO] [--seconds 8] [--rounds 3] [--points 500]
Costs are seconds of a processor. Trainings with one and two workers, with two processes, and with the network of `small`
take turns, so that other load meets all of them; each is predicted for the processors that it got, and the prediction for
8 GPUs and 128 cores follows. Processes lose the start of each turn: what was prepared while others had theirs.
"""

from __future__ import annotations

import sips_lit.cli

# isort: split

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import psutil
import torch
from tabulate import tabulate
from threadpoolctl import threadpool_limits

import sips_lit.train.loader
import sips_lit.train.stream
from sips_lit.datasets.demo import demo_stills
from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.describe.sift import RootSift
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, SelectedPoints, image_tensor, logits_at
from sips_lit.frames.video import video
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.train.augment import Augmentation
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.dataset import PackedPairs, TrainingPairs, pack
from sips_lit.train.labelling import label_pair
from sips_lit.train.loader import LabelledPair, OneStepAhead
from sips_lit.types import GreyImage, ImageSequence, Keypoints

RATE = 30  # frames a second of the videos that are spoken of
AGREES = 0.25  # how far measured pairs per second may be from those predicted
BUSY = 8  # seconds that another training runs beside what is measured


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds of one core for a pair: frames read and augmented, labels, and the network with its selection of points."""

    read: float
    label: float
    network: float

    def pairs_per_second(self, loading: int, labelling: int, cores: float, on_gpu: float = 0.0) -> float:
        """The least of what loading workers, labelling threads, the network and all cores can do.

        ``on_gpu``: seconds of a pair on a GPU, which then takes no core.
        """
        network = on_gpu or self.network
        work = self.read + self.label + (0 if on_gpu else self.network)
        return min(loading / self.read, labelling / self.label, 1 / network, cores / work)


def median(costs: Sequence[Costs]) -> Costs:
    """Of each cost."""
    return Costs(*np.median([astuple(each) for each in costs], axis=0).tolist())


class Network:
    """What a step does with the network of `small` on one thread, or with ``learns`` false a corner detector alone."""

    def __init__(self, points: int, learns: bool) -> None:
        self.points, self.learns = points, learns
        self.network, self.selector = ScoreNetwork(), PointSelector()
        self.optimizer = torch.optim.Adam(self.network.parameters(), 3e-4)

    def select(self, images: Sequence[GreyImage]) -> list[SelectedPoints]:
        """The points that a pair is labelled for."""
        return list(map(self._select_in, images))

    def _select_in(self, image: GreyImage) -> SelectedPoints:
        if self.learns:
            return self.selector.select(self.network, image_tensor(image), self.points)
        xy = cv2.goodFeaturesToTrack(image, self.points, 1e-4, 5).reshape(-1, 2)
        score, none = np.linspace(1, 0, len(xy), dtype=np.float32), np.zeros(len(xy), np.int64)
        return SelectedPoints(Keypoints(xy, score, np.ones(len(xy), np.float32)), none, none, none)

    def step(self, pair: LabelledPair) -> None:
        """Forward, backward and optimiser at the points of a pair."""
        if self.learns:
            images, points = (pair.image0, pair.image1), (pair.points0, pair.points1)
            logits = logits_at(self.network, images, points, "patches")
            wanted = torch.from_numpy(np.concatenate([pair.labels0.share, pair.labels1.share]))
            self.optimizer.zero_grad()
            torch.nn.functional.binary_cross_entropy_with_logits(torch.cat(logits), wanted).backward()
            self.optimizer.step()


def prepared(path: Path, folder: Path) -> TrainingPairs:
    """The pairs that a training on the video draws."""
    data = PairDataModule(
        video(path, folder / "frames"), RootSift(), RetracedKltInliers(), folder / "indexes", val_pairs=2
    )
    data.prepare_data()
    data.setup("fit")
    return TrainingPairs(data.sources, data.sampler, data.inliers, Augmentation(), 10**6)


def one_thread() -> None:
    """Nothing but the workers that are counted runs beside the main thread, and workers do not make way for it."""
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")
    for module in (sips_lit.train.loader, sips_lit.train.stream):
        module.step_back = lambda: None  # type: ignore[attr-defined]  # they would starve beside other programs


def measured_costs(pairs: TrainingPairs, network: Network, threads: int, count: int = 12) -> tuple[Costs, float]:
    """Costs of a pair, labelled by so many threads, as the mean of the first ones, and how many frames one has."""
    spent = {"read": 0.0, "label": 0.0, "network": 0.0}

    def timed(stage: str, call: Callable[[], Any]) -> Any:
        start = time.process_time()
        result = call()
        spent[stage] += (time.process_time() - start) / count
        return result

    frames, pool = 0, ThreadPoolExecutor(threads)
    label = partial(label_pair, descriptor=RootSift(), check=RetracedKltInliers(), parallel=pool.map, parts=threads)
    for index in range(-2, count):
        if not index:  # what is made at the first call is no cost of a pair
            spent, frames = dict.fromkeys(spent, 0.0), 0
        item = timed("read", lambda index=index: pairs[index + 2])
        timed("read", lambda item=item: pack(item))
        pair, images = item.pair, (item.pair.image0, item.pair.image1)
        points = timed("network", lambda images=images: network.select(images))
        at = [selected.keypoints for selected in points]
        labels = timed("label", lambda pair=pair, at=at: label(pair, *at))
        tensors = image_tensor(images[0]), image_tensor(images[1])
        labelled = LabelledPair(*tensors, *points, *labels, 0, pair.name)
        timed("network", lambda labelled=labelled: network.step(labelled))
        frames += len(pair.frames)
    return Costs(**spent), frames / count


def serve(path: Path, folder: Path, loading: int, labelling: int, network: Network) -> None:
    """Trains for as many seconds as a line of the input says, and prints pairs, seconds, and those of processors."""
    pairs = PackedPairs(prepared(path, folder))
    loader = OneStepAhead(pairs, network.select, RootSift(), [RetracedKltInliers()], loading, labelling)
    stream = iter(loader)

    def used() -> float:
        own = psutil.Process()
        times = [process.cpu_times() for process in (own, *own.children(recursive=True))]
        return float(sum(t.user + t.system for t in times))

    for _ in range(3):
        network.step(next(stream))
    print("ready", flush=True)
    for line in sys.stdin:
        for _ in range(2 * loading + 2):
            network.step(next(stream))
        start, before, count = time.perf_counter(), used(), 0
        while time.perf_counter() - start < float(line):
            network.step(next(stream))
            count += 1
        print(json.dumps([count, time.perf_counter() - start, used() - before]), flush=True)


class Trainer:
    """``processes`` that `serve` on ``loading`` and ``labelling`` workers each, with a network or without."""

    def __init__(self, command: list[str], processes: int, loading: int, labelling: int, learns: bool) -> None:
        self.processes, self.loading, self.labelling, self.learns = processes, loading, labelling, learns
        command = [*command, "--serve", str(loading), str(labelling), str(int(learns))]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.running = [subprocess.Popen(command, **pipes) for _ in range(processes)]
        self.turns: list[tuple[float, float]] = []

    def say(self, line: str) -> None:
        """To all processes."""
        for process in self.running:
            print(line, file=process.stdin, flush=True)

    def heard(self) -> list[str]:
        """A line of each process."""
        return [process.stdout.readline() for process in self.running if process.stdout]

    def turn(self, seconds: float) -> None:
        """Pairs per second and processors of all processes for a while."""
        self.say(str(seconds))
        told = [json.loads(line) for line in self.heard()]
        self.turns.append((sum(n / wall for n, wall, _ in told), sum(cpu / wall for _, wall, cpu in told)))

    def row(self, costs: Costs) -> list[Any]:
        """Measured beside predicted, medians of the turns."""
        rate, cores = np.median(self.turns, axis=0)
        each = costs.pairs_per_second(self.loading, self.labelling, cores / self.processes)
        name = f"{self.processes} x ({self.loading} loading, {self.labelling} labelling{', network' * self.learns})"
        return [name, cores, rate, self.processes * each, rate / (self.processes * each)]


def write_video(path: Path) -> Path:
    """A flight over a photograph as H.264."""
    flight = flights_over(demo_stills(["coffee"]), size=(640, 480), length=150, flights_per_still=1)[0]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", RATE, {"crf": "20"})
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv420p"
        for index in range(len(flight)):
            frame = av.VideoFrame.from_ndarray(flight.frame(index), format="gray")
            container.mux(stream.encode(frame.reformat(format="yuv420p")))
        container.mux(stream.encode())
    return path


def from_video(path: Path, first: int, count: int, size: tuple[int, int]) -> Iterator[GreyImage]:
    """Frames straight from the video, found from the keyframe before."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_count = 1
        step = 1 / (stream.average_rate or RATE)
        container.seek(int(first * step / stream.time_base), stream=stream)
        for frame in container.decode(stream):
            if frame.time is not None and frame.time >= (first - 0.5) * step:
                yield np.asarray(cv2.resize(frame.to_ndarray(format="gray"), size, interpolation=cv2.INTER_AREA))
                count -= 1
            if not count:
                return


def ways_to_read(path: Path, shot: ImageSequence, folder: Path, count: int) -> list[list[Any]]:
    """For each way: milliseconds of a core to read ``count`` frames in a row, and GB for an hour."""
    height, width = shot.frame(0).shape
    encoded = []
    for index in range(len(shot)):
        encoded.append(cv2.imencode(".png", shot.frame(index), (cv2.IMWRITE_PNG_COMPRESSION, 1))[1])
    starts = np.linspace(0, len(shot) - count - 1, 12).astype(int).tolist()
    hour = 3600 * RATE / len(shot) / 1e9
    ways: dict[str, tuple[Callable[[int], Any], float]] = {
        "frame cache (raw)": (lambda at: [shot.frame(i) for i in range(at, at + count)], len(shot) * height * width),
        "PNG": (
            lambda at: [cv2.imdecode(encoded[i], cv2.IMREAD_UNCHANGED) for i in range(at, at + count)],
            sum(map(len, encoded)),
        ),
        "the video, by PyAV": (lambda at: list(from_video(path, at, count, (width, height))), path.stat().st_size),
    }
    rows = []
    for name, (read, size) in ways.items():
        assert len(read(starts[0])) == count
        start = time.process_time()
        for at in starts:
            read(at)
        rows.append([name, 1000 * (time.process_time() - start) / len(starts), size * hour])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("video", nargs="?", type=Path, help="of a moving camera; default: a flight over a photograph")
    parser.add_argument("--seconds", type=float, default=8, help="of a turn")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--gpu", type=float, default=0.02, help="seconds that a pair takes a GPU, to predict with")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--serve", type=int, nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    one_thread()
    if arguments.serve:
        loading, labelling, learns = arguments.serve
        serve(arguments.video, arguments.folder, loading, labelling, Network(arguments.points, bool(learns)))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        path = arguments.video or write_video(folder / "flight.mp4")
        start = time.process_time()
        pairs = prepared(path, folder)
        (shot, *_) = shots = video(path, folder / "frames")
        a_frame = (time.process_time() - start) / sum(map(len, shots))
        print(
            f"decoded, cut and indexed: {1000 * a_frame:.0f} ms of a core for a frame, {a_frame * RATE:.1f} hours of a core "
            "for an hour of video"
        )
        costs, frames = measured_costs(pairs, Network(arguments.points, learns=True), 1)
        told = {name: f"{1000 * value:.0f} ms" for name, value in asdict(costs).items()}
        print(f"a pair of {arguments.points} points and {frames:.1f} frames, on one core: {told}", flush=True)
        rows = ways_to_read(path, shot, folder, min(round(frames), len(shot) // 2))
        print(
            tabulate(
                rows, ["frames from", f"ms for {round(frames)} frames", f"GB an hour at {RATE} f/s"], floatfmt=".1f"
            )
        )
        stored = sum(file.stat().st_size for file in (folder / "indexes").glob("*.npz"))
        print(f"overlap index: {stored / sum(map(len, shots)) * 3600 * RATE / 1e9:.3f} GB an hour")
        check(arguments, path, folder, pairs)
        predict(costs, arguments.gpu, frames * shot.frame(0).size)


def predict(costs: Costs, gpu: float, size: float) -> None:
    """Prints pairs per second of 8 GPUs and 128 cores, and what their storage has to give; a pair has ``size`` bytes."""
    labels, both = 128 / (costs.read + costs.label), 8 * costs.pairs_per_second(16, 16, 16, gpu)
    print(
        f"128 cores, predicted: {labels:.0f} pairs per second without a network, {labels * size / 1e9:.1f} GB/s of frames"
    )
    print(
        f"with 8 GPUs, if a pair takes one {1000 * gpu:.0f} ms (not measured here): {both:.0f} pairs per second, "
        f"{both * size / 1e9:.1f} GB/s of frames"
    )


def check(arguments: argparse.Namespace, path: Path, folder: Path, pairs: TrainingPairs) -> None:
    """Measured pairs per second beside the model's. Raises SystemExit where they do not agree."""
    command = [sys.executable, __file__, str(path), "--folder", str(folder), "--points", str(arguments.points)]
    kinds = ((1, 1, 1, False), (1, 2, 2, False), (2, 1, 1, False), (1, 1, 1, True))
    trainers = [Trainer(command, *kind) for kind in kinds]
    networks = {learns: Network(arguments.points, learns) for learns in (False, True)}
    measured = defaultdict[tuple[bool, int], list[Costs]](list)
    for trainer in trainers:
        assert set(trainer.heard()) == {"ready\n"}
    for _ in range(arguments.rounds):
        for learns, labelling in sorted({(trainer.learns, trainer.labelling) for trainer in trainers}):
            trainers[0].say(str(BUSY))  # a pair costs more where the other cores are busy, as they are in a training
            costs, _ = measured_costs(pairs, networks[learns], labelling, 4 if learns else 12)
            trainers[0].heard()
            measured[learns, labelling].append(costs)
        for trainer in trainers:
            trainer.turn(arguments.seconds)
    for process in (process for trainer in trainers for process in trainer.running):
        process.communicate("")
    rows = [trainer.row(median(measured[trainer.learns, trainer.labelling])) for trainer in trainers]
    headers = ["processes and workers", "cores it got", "pairs/s", "predicted", "measured / predicted"]
    print(f"{os.cpu_count()} cores; medians of {arguments.rounds} turns of {arguments.seconds:g} s")
    print(tabulate(rows, headers, floatfmt=".2f"))
    wrong = [row[0] for row in rows if abs(row[-1] - 1) > AGREES]
    print(f"limit: measured / predicted within {1 - AGREES:g} and {1 + AGREES:g}")
    if wrong:
        sys.exit(f"over the limit: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
