"""Kills a tiny training at random, resumes it, and compares its end bit for bit with a run that nobody disturbed.

``python benchmarks/kills.py --kills 100``: of a hundred kills, 20 fall while a checkpoint is written, 20 are a SIGTERM in
one phase after the other, 10 a SIGTERM and 50 a SIGKILL at any time. Runs are processes forked from this one, which has
the modules loaded; their outputs and their temporary folder are on different file systems, either way round.
"""

from __future__ import annotations

import sips_lit.cli  # noqa: F401 - first: it sets how OpenMP threads wait

# isort: split

import argparse
import contextlib
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import lightning as L
import numpy as np
import torch

from sips_lit.cli import train as train_command
from sips_lit.detect.checkpoint import is_sound
from sips_lit.train import checkpoint_io
from sips_lit.train.checkpoint_io import WholeCheckpointIO

STEPS, BETWEEN_VALIDATIONS, PAIRS_A_STEP = 8, 3, 2
TINY = [
    "data=folder", "model.depth=3", "model.width=4", "module.points=40", "n_max=60", "datamodule.val_fraction=0.3",
    "datamodule.val_pairs=2", "datamodule.loading_workers=1", "datamodule.labelling_workers=1",
    "callbacks.pictures.count=1", "trainer.precision=32-true", "trainer.accelerator=cpu",
    f"trainer.max_steps={STEPS}", f"trainer.val_check_interval={BETWEEN_VALIDATIONS}",
    f"trainer.accumulate_grad_batches={PAIRS_A_STEP}", "trainer.num_sanity_val_steps=1",
]  # fmt: skip
COMPARISON = [
    "+evaluation@compare=default", "+compare.detectors=[sips]", "+compare.descriptor=${descriptor}",
    "+compare.inliers=${inliers}", "+compare.data=${data}", "compare.pairs=3", "compare.n_max=60", "compare.n=40",
    "compare.calibration=[40]", "compare.pictures=false", "compare.repeats=1",
]  # fmt: skip
PHASES = ("set-up", "sanity check", "training", "within a step", "validation", "last validation", "comparison")
SAVED = PHASES[2:]  # phases in which a signal leaves a checkpoint
AT_ANY_TIME = {"SIGKILL at any time": signal.SIGKILL, "SIGTERM at any time": signal.SIGTERM}
Sabotage = Callable[[], None]


@dataclass
class Figures:
    """What came of the kills."""

    kills: Counter[str] = field(default_factory=Counter)
    runs: int = 0
    equal: int = 0
    wrong: list[str] = field(default_factory=list)
    chain: Counter[int] = field(default_factory=Counter)

    def __str__(self) -> str:
        kinds = "\n".join(f"  {count:4d} {kind}" for kind, count in sorted(self.kills.items()))
        wrong = "".join(f"\n  wrong: {line}" for line in self.wrong)
        most = max(self.chain, default=0)
        return (
            f"{sum(self.kills.values())} kills\n{kinds}\n{self.runs} runs ended, up to {most} kills each; {self.equal} are "
            f"bit-equal to the undisturbed run{wrong}"
        )


def write_frames(folder: Path, count: int = 16) -> None:
    """A camera that moves over a random texture."""
    ground = np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8)
    ground = cv2.resize(ground, (320, 240), interpolation=cv2.INTER_CUBIC)
    folder.mkdir(parents=True)
    for index in range(count):
        assert cv2.imwrite(str(folder / f"{index:03d}.png"), ground[2 * index :, 3 * index :][:96, :128])


def in_child(arguments: list[str], temporary: Path, log: Path, sabotage: Sabotage) -> None:
    """`sips-train` in a process group of its own, with a temporary folder of its own."""
    os.setsid()
    os.environ["TMPDIR"], tempfile.tempdir = str(temporary), None
    with log.open("a") as handle:
        os.dup2(handle.fileno(), 1)
        os.dup2(handle.fileno(), 2)
    sys.argv = ["sips-train", *arguments]
    sabotage()
    train_command.main()


class SignalIn(L.Callback):
    """Sends the process group a signal in a phase of a training, as a scheduler does; to the process alone by chance."""

    def __init__(self, phase: str, step: int, group: bool) -> None:
        self.phase, self.step, self.group, self.done = phase, step, group, False

    def send(self, here: bool = True) -> None:
        if here and not self.done:
            self.done = True
            # from a process of its own: loading workers obey their parent, and not a scheduler
            target = f"-{os.getpid()}" if self.group else f"{os.getpid()}"
            subprocess.run(["kill", "-TERM", "--", target], check=True, start_new_session=True)

    def setup(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        self.send(self.phase == "set-up")

    def on_train_batch_start(self, trainer: L.Trainer, pl_module: Any, batch: Any, batch_idx: int) -> None:
        within = batch_idx % trainer.accumulate_grad_batches != 0
        due = trainer.global_step >= self.step
        self.send(due and self.phase == ("within a step" if within else "training"))

    def on_validation_batch_start(self, trainer: L.Trainer, *_: Any) -> None:
        last = trainer.global_step == STEPS
        kind = "sanity check" if trainer.sanity_checking else "last validation" if last else "validation"
        self.send(kind == self.phase)


def signal_in(phase: str, step: int, group: bool) -> None:
    """Makes the run of this process get a SIGTERM in a phase."""
    sender = SignalIn(phase, step, group)
    callbacks, benchmark = train_command.make_callbacks, train_command.benchmark

    def compare(config: Any) -> Any:
        signal.signal(signal.SIGALRM, lambda *_: sender.send())
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        return benchmark(config)

    train_command.make_callbacks = lambda config: [*callbacks(config), sender]
    if phase == "comparison":
        train_command.benchmark = compare


def kill_in_writing(count: int, delay: float) -> None:
    """Lets the kernel kill this process ``delay`` seconds after it began to write its ``count``-th checkpoint."""
    write, save, written = checkpoint_io.write_whole, WholeCheckpointIO.save_checkpoint, [0]

    def timed_write(path: Path, content: Any) -> None:
        written[0] += 1
        if written[0] == count:
            signal.setitimer(signal.ITIMER_REAL, delay)  # nobody handles SIGALRM: it ends the process as SIGKILL does
        write(path, content)

    def timed_save(self: WholeCheckpointIO, *arguments: Any, **options: Any) -> None:
        save(self, *arguments, **options)
        signal.setitimer(signal.ITIMER_REAL, 0)

    checkpoint_io.write_whole = timed_write
    WholeCheckpointIO.save_checkpoint = timed_save  # type: ignore[method-assign]


def record_writing(report: Path) -> None:
    """Notes how long each checkpoint takes to be written."""
    write, save, began = checkpoint_io.write_whole, WholeCheckpointIO.save_checkpoint, [0.0]

    def timed_write(path: Path, content: Any) -> None:
        began[0] = time.perf_counter()
        write(path, content)

    def timed_save(self: WholeCheckpointIO, *arguments: Any, **options: Any) -> None:
        save(self, *arguments, **options)
        with report.open("a") as out:
            out.write(f"{time.perf_counter() - began[0]}\n")

    checkpoint_io.write_whole = timed_write
    WholeCheckpointIO.save_checkpoint = timed_save  # type: ignore[method-assign]


@dataclass
class Site:
    """Where one run is: outputs on one file system, the temporary folder on another."""

    root: Path
    temporary: Path
    frames: Path
    compares: bool = False  # with other detectors, after the training

    @property
    def run(self) -> Path:
        return self.root / "outputs" / "run"

    @property
    def last(self) -> Path:
        return self.run / "checkpoints" / "last.ckpt"

    @property
    def log(self) -> Path:
        return self.root / "log.txt"

    def start(self, sabotage: Sabotage = lambda: None) -> multiprocessing.process.BaseProcess:
        """Starts the run, or goes on with it where it has a checkpoint."""
        self.root.mkdir(parents=True, exist_ok=True)
        self.temporary.mkdir(parents=True, exist_ok=True)
        paths = [f"data.path={self.frames}", f"paths.data={self.root}/data", f"paths.outputs={self.root}/outputs"]
        resume = ["ckpt_path=last"] if self.last.exists() else []
        comparison = COMPARISON if self.compares else []
        arguments = [*TINY, *comparison, *paths, f"hydra.run.dir={self.run}", *resume]
        child = multiprocessing.get_context("fork").Process(
            target=in_child, args=(arguments, self.temporary, self.log, sabotage)
        )
        child.start()
        return child

    def content(self) -> dict[str, Any]:
        """What the run ended with; its folder, which is in it, has a neutral name."""
        files = {name: self.run / "checkpoints" / f"{name}.ckpt" for name in ("last", "best")}
        return {n: neutral(torch.load(f, weights_only=True), str(self.root)) for n, f in files.items()}

    def remove(self) -> None:
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.rmtree(self.temporary, ignore_errors=True)


def neutral(node: Any, folder: str) -> Any:
    if isinstance(node, dict):
        # the score of the last time that best.ckpt was written: Lightning does not read it back, and nothing else does
        return {neutral(k, folder): neutral(value, folder) for k, value in node.items() if k != "current_score"}
    if isinstance(node, list | tuple):
        return [neutral(value, folder) for value in node]
    return node.replace(folder, "FOLDER") if isinstance(node, str) else node


def differences(a: Any, b: Any, where: str = "") -> list[str]:
    """The places at which two nested structures differ in a value, a type or a bit."""
    if type(a) is not type(b):
        return [f"{where}: {a!r} and {b!r}"[:200]]
    if isinstance(a, dict):
        if a.keys() != b.keys():
            return [f"{where}: keys {sorted(map(str, a.keys() ^ b.keys()))}"]
        return [line for key in a for line in differences(a[key], b[key], f"{where}/{key}")]
    if isinstance(a, list):
        if len(a) != len(b):
            return [f"{where}: {len(a)} and {len(b)} entries"]
        return [line for i, pair in enumerate(zip(a, b, strict=True)) for line in differences(*pair, f"{where}/{i}")]
    if isinstance(a, torch.Tensor):
        same = a.dtype == b.dtype and a.shape == b.shape and a.numpy().tobytes() == b.numpy().tobytes()
        return [] if same else [where]
    return [] if a == b or (a != a and b != b) else [f"{where}: {a!r} and {b!r}"]


def ended(child: multiprocessing.process.BaseProcess, seconds: float = 120) -> int | None:
    """The exit code, None if it hangs; nothing of its process group is left."""
    child.join(seconds)
    code = child.exitcode
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid or 0, signal.SIGKILL)
    child.join()
    return code


class Trial:
    """An undisturbed run, and disturbed ones that are compared with it."""

    def __init__(self, folders: tuple[Path, Path], seed: int) -> None:
        self.folders, self.random, self.figures = folders, random.Random(seed), Figures()
        self.frames = folders[0] / "frames"
        write_frames(self.frames)
        site, report = self.site("whole"), folders[0] / "writing.txt"
        began = time.perf_counter()
        code = ended(site.start(partial(record_writing, report)))
        assert code == 0, site.log.read_text()
        self.seconds = time.perf_counter() - began
        self.writing = [float(line) for line in report.read_text().split()]
        self.pace: defaultdict[str, float] = defaultdict(lambda: 1.0)  # of the machine now, by what came too late
        self.whole = site.content()
        site.remove()

    def site(self, name: str) -> Site:
        there, here = self.random.sample(self.folders, 2)
        return Site(there / name, here / f"{name}-temporary", self.frames)

    def kill(self, site: Site, kind: str) -> bool:
        """One kill of a run, which starts or goes on for it; False if the run was faster."""
        if kind in AT_ANY_TIME:
            number, child = AT_ANY_TIME[kind], site.start()
            time.sleep(self.random.uniform(0, self.seconds * self.pace[kind]))
            if child.is_alive():
                os.kill(child.pid or 0, number)
            code = ended(child)
            if code == -signal.SIGTERM:  # before the command has begun
                code = 128 + signal.SIGTERM
            return self.judge(site, kind, code, 128 + number if number == signal.SIGTERM else -number)
        if kind == "while a checkpoint is written":
            delay = self.random.uniform(0, float(np.median(self.writing)) * self.pace[kind])
            count = self.random.randint(1, len(self.writing))
            return self.judge(site, kind, ended(site.start(partial(kill_in_writing, count, delay))), -signal.SIGALRM)
        phase, step = kind.removeprefix("SIGTERM in: "), self.random.randint(0, STEPS - 2)
        site.compares = phase == "comparison"
        code = ended(site.start(partial(signal_in, phase, step, self.random.random() < 0.5)))
        if phase in SAVED and code == 143 and not site.last.exists():
            self.wrong(site, f"{kind} saved nothing")
        return self.judge(site, kind, code, 128 + signal.SIGTERM)

    def judge(self, site: Site, kind: str, code: int | None, expected: int) -> bool:
        if code not in (expected, 0):
            self.wrong(site, f"{kind} ended in code {code}")
        if code == expected:
            self.figures.kills[kind] += 1
        self.pace[kind] *= 1.1 if code == expected else 0.8
        checkpoints = site.run / "checkpoints"
        for name in ("last", "last.previous", "best", "best.previous"):
            path = checkpoints / f"{name}.ckpt"
            if path.exists() and not is_sound(path):
                self.wrong(site, f"{kind} left {path.name} damaged")
        return code == expected

    def wrong(self, site: Site, what: str) -> None:
        log = site.log.read_text().splitlines() if site.log.exists() else []
        self.figures.wrong.append(f"{what} ({site.root.name}; {' | '.join(log[-3:])})")

    def finish(self, site: Site, kills: int) -> None:
        """Lets a run end and compares it."""
        code = ended(site.start())
        self.figures.runs += 1
        self.figures.chain[kills] += 1
        if code != 0:
            self.wrong(site, f"the resumed run ended in code {code}")
            return
        found = differences(self.whole, site.content())
        self.figures.equal += not found
        if found:
            self.wrong(site, f"{len(found)} differences, {found[:3]}")
        site.remove()

    def run(self, kinds: list[str]) -> Figures:
        """Every kind once as a kill that hit; one, two or three of them in a run."""
        left, number = list(kinds), 0
        while left:
            site, kills = self.site(f"run{number}"), 0
            number += 1
            for _ in range(self.random.randint(1, 3)):
                if left and self.kill(site, left[-1]):
                    left.pop()
                    kills += 1
                if site.last.exists() and torch.load(site.last, weights_only=True)["global_step"] == STEPS:
                    break
            self.finish(site, kills)
            print(
                f"{len(kinds) - len(left)} of {len(kinds)} kills, {self.figures.equal} of {number} runs equal",
                flush=True,
            )
        return self.figures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--disks", nargs=2, type=Path, default=(Path("/tmp"), Path("/dev/shm")), help="two file systems"
    )
    options = parser.parse_args()
    torch.set_num_threads(1)
    fifth = options.kills // 5
    kinds = ["while a checkpoint is written"] * fifth
    phases = random.Random(options.seed).sample(PHASES, len(PHASES))
    kinds += [f"SIGTERM in: {phases[index % len(phases)]}" for index in range(fifth)]
    kinds += ["SIGTERM at any time"] * (options.kills // 10)
    kinds += ["SIGKILL at any time"] * (options.kills - len(kinds))
    with (
        tempfile.TemporaryDirectory(dir=options.disks[0]) as one,
        tempfile.TemporaryDirectory(dir=options.disks[1]) as two,
    ):
        devices = {Path(folder).stat().st_dev for folder in (one, two)}
        print("two file systems" if len(devices) == 2 else "ONE file system: name two with --disks")
        trial = Trial((Path(one), Path(two)), options.seed)
        print(
            f"an undisturbed run: {trial.seconds:.1f} s; a checkpoint is written in {np.median(trial.writing) * 1e3:.1f} ms"
        )
        trial.random.shuffle(kinds)
        figures = trial.run(kinds)
    print(figures)
    return 1 if figures.wrong or figures.equal < figures.runs else 0


if __name__ == "__main__":
    sys.exit(main())
