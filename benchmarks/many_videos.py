"""Training and indexing of very many videos, simulated by links to a few clips: start, memory, and time of a draw.

python benchmarks/many_videos.py [PATHS ...] [--videos 10000]
Every link has a name, a frame cache (a link, too) and an overlap index of its own, as a video would; only decoding and
tracking are left out. A hundredth of the videos, a tenth and all are measured, each in a process of its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import psutil
from tabulate import tabulate

from sips_lit.cli.explain import plain_warnings
from sips_lit.datasets.demo import demo_stills
from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.describe.sift import RootSift
from sips_lit.frames.video import VideoShot, video
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.index_file import index_path, save_index
from sips_lit.pairs.index_run import index_recordings
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.stored import HELD
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.dataset import TrainingPairs

START = 60.0  # seconds, at most, until a training has its first pair
MORE = 150.0  # MB, at most, that a process needs more for all videos than for a hundredth of them
GROWTH = 1.5  # times as long, at most, a draw may take from all videos as from a hundredth of them
LEAK = HELD / 1e6 + 20  # MB, at most, that draws may add: what is held of indexes
DRAWS = 1000
BROKEN = 10  # videos that can't be read


@dataclass(frozen=True, slots=True)
class Measured:
    """Seconds to start, and to start again; MB before, after and `DRAWS` draws later; ms of a draw; open files; speed."""

    videos: int
    start: float
    again: float
    before: float
    after: float
    later: float
    draw: float
    files: int
    indexing: float


def resident() -> float:
    """MB of this process."""
    return float(psutil.Process().memory_info().rss / 1e6)


def write_clips(folder: Path, length: int) -> list[Path]:
    """A few small videos: flights over photographs."""
    folder.mkdir()
    paths = []
    for still in ("coffee", "astronaut", "chelsea"):
        flight = flights_over(demo_stills([still]), size=(320, 240), length=length, flights_per_still=1)[0]
        paths.append(folder / f"{still}.avi")
        writer = cv2.VideoWriter(str(paths[-1]), cv2.VideoWriter.fourcc(*"MJPG"), 30, (320, 240))
        for index in range(length):
            writer.write(cv2.cvtColor(flight.frame(index), cv2.COLOR_GRAY2BGR))
        writer.release()
    return paths


def link_videos(root: Path, clips: list[Path], count: int) -> None:
    """``root/list.txt`` of ``count`` links to the clips, with their frames and indexes, and of some broken files."""
    parameters, cache, indexes = OverlapParameters(), root / "frames", root / "indexes"
    originals = [video(clip, cache) for clip in clips]
    measured = [build_indexes(shots, indexes, parameters) for shots in originals]
    names = []
    for number in range(count):
        clip, shots, tables = (each[number % len(clips)] for each in (clips, originals, measured))
        name = f"video{number:06d}"
        link = root / "videos" / f"{number // 1000:03d}" / f"{name}{clip.suffix}"
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(clip.resolve())
        names.append(str(link))
        (cache / f"{name}-{shots[0].fingerprint[:8]}").symlink_to(shots[0].cache.parent)  # type: ignore[attr-defined]
        for shot, index in zip(shots, tables, strict=True):
            assert isinstance(shot, VideoShot)
            own = shot.name.replace(clip.stem, name, 1)
            copy = VideoShot(shot.cache, shot.shape, shot.start, shot.stop, own, shot.fingerprint.split("[")[0])
            save_index(index_path(indexes, copy), index.read(), parameters.signature(copy))
    for number in range(BROKEN):
        names.insert(number, str(root / f"broken{number}.avi"))
        Path(names[number]).write_bytes(b"no video at all" * 100)
    (root / "list.txt").write_text("\n".join(names))


def measure(root: Path, count: int) -> Measured:
    """A training over the first ``count`` videos of the list, without the network, and an indexing."""
    part = root / f"list{count}.txt"
    part.write_text("\n".join((root / "list.txt").read_text().splitlines()[: count + BROKEN]))

    def started() -> tuple[float, TrainingPairs]:
        begin = time.perf_counter()
        data = PairDataModule(video(part, root / "frames"), RootSift(), RetracedKltInliers(), root / "indexes")
        data.prepare_data()
        data.setup("fit")
        pairs = TrainingPairs(data.sources, data.sampler, data.inliers, None, 10**6)
        assert len(pairs[0].pair.frames) > 1
        return time.perf_counter() - begin, pairs

    before = resident()
    start, pairs = started()
    after = resident()
    for index in range(DRAWS):
        pairs.name(index)
    later, files = resident(), psutil.Process().num_fds()
    again, pairs = started()
    for sampler in pairs.sampler.samplers:  # nothing is held: each draw reads an index, as among very many videos
        sampler._eligible.limit = 0
        for stored in sampler.indexes:
            stored.catalogue.tables.limit = 0  # type: ignore[attr-defined]
    times = []
    for index in range(DRAWS):
        begin = time.perf_counter()
        pairs.name(index)
        times.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    recordings = video.recordings(part, root / "frames")
    rows = list(index_recordings(recordings, root / "indexes", OverlapParameters(), 0.1, 1))
    assert len([row for row in rows if row[0].failed]) == BROKEN
    indexing = time.perf_counter() - begin
    return Measured(
        count, start, again, before, after, later, float(np.median(times)) * 1e3, files, len(rows) / indexing
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, help="videos to link to; default: flights over photographs")
    parser.add_argument("--videos", type=int, default=10_000)
    parser.add_argument("--frames", type=int, default=150, help="of each clip, if it is made")
    parser.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        plain_warnings()
        print(json.dumps(asdict(measure(arguments.paths[0], arguments.measure))))
        return
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        link_videos(root, arguments.paths or write_clips(root / "clips", arguments.frames), arguments.videos)
        size = sum(path.stat().st_size for path in (root / "indexes").glob("*.npz"))
        print(f"{arguments.videos} videos, {BROKEN} broken ones, {size / 1e6:.0f} MB of indexes", flush=True)
        rows = []
        for count in (arguments.videos // 100, arguments.videos // 10, arguments.videos):
            command = [sys.executable, __file__, str(root), "--measure", str(count)]
            told = subprocess.run(command, check=True, capture_output=True, text=True)
            rows.append(Measured(**json.loads(told.stdout.splitlines()[-1])))
            lines = [line for line in told.stderr.splitlines() if line.startswith("warning")]
            print(f"{count} videos: {len(lines)} lines of warnings, the first: {lines[0]}", flush=True)
    report(rows, len(lines))


def report(rows: list[Measured], lines: int) -> None:
    """A table, and each figure beside its limit; raises SystemExit where one is missed."""
    headers = [
        "videos",
        "start s",
        "next start s",
        "MB before",
        "MB started",
        f"MB after {DRAWS} draws",
        "draw and reading ms",
    ]
    print(
        tabulate([list(asdict(row).values()) for row in rows], [*headers, "open files", "indexed / s"], floatfmt=".2f")
    )
    few, most = rows[0], rows[-1]
    limits = [
        ("seconds to start a training", most.start, START),
        ("MB for all videos, more than for a hundredth", (most.after - most.before) - (few.after - few.before), MORE),
        (f"MB that {DRAWS} draws add", most.later - most.after, LEAK),
        ("time of a draw against a hundredth of the videos", most.draw / few.draw, GROWTH),
        ("open files, more than with a hundredth", most.files - few.files, 0),
        ("lines of warnings per broken video", lines / BROKEN, 1),
    ]
    missed = []
    for name, value, limit in limits:
        print(f"{name}: {value:.2f} (limit {limit:g})")
        missed += [name] if value > limit else []
    if missed:
        sys.exit(f"over the limit: {', '.join(missed)}")


if __name__ == "__main__":
    main()
