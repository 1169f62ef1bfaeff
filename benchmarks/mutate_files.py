"""Damaged files through every reader: python benchmarks/mutate_files.py [--files 10000] [--seed 0] [--only PATTERN]

Small files of every kind (``tests/support/every_file.py``) get one to three seeded mutations each: flipped bits, cuts,
blocks that are zeroed, doubled, moved or replaced, other lengths and numbers. Another process reads them, with limits of
time and memory. A reader must give what can be used or raise BadInputError; prints the figures of each kind, and every
file that made a reader fail otherwise, hang, or take too much memory, and exits with 1 if there is any.
"""

from __future__ import annotations

import argparse
import fnmatch
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
SECONDS = 10.0  # that a reader may take
MEMORY = 10**9  # bytes that the reading process may hold, with all its libraries
HARD_LIMIT = 6 * 10**9  # of its address space, so that the machine survives
ENDS = 400  # bytes at either end of a file that half of the mutations are in: there are the headers
EXTREMES = (0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1)
WORDS = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "9" * 25,
    "9" * 5000,
    "a" * 300,
    "../x",
    "/",
    "*",
    "\0",
    "é",
    "",
)
WORDS += (",", "\n", "#", "[", "{", "null", "true", "0x10", "1_0", "٣", "1.5.2", "%YAML", "!!python/object:os.system")


def mutated(content: bytes, generator: np.random.Generator) -> bytes:
    """The content with one to three mutations."""
    for _ in range(generator.integers(1, 4)):
        content = _mutation(content, generator)
    return content


def _mutation(content: bytes, generator: np.random.Generator) -> bytes:
    if not content:
        return bytes(generator.integers(0, 256, 8, np.uint8))
    at = int(generator.integers(len(content)))
    if generator.random() < 0.5:
        at = int(generator.integers(min(ENDS, len(content))))
        at = len(content) - 1 - at if generator.random() < 0.4 else at
    block = int(generator.choice([1, 4, 16, 64, 512, max(1, len(content) // 4)]))
    before, middle, after = content[:at], content[at : at + block], content[at + block :]
    if content.isascii() and generator.random() < 0.6:
        start = max(content.rfind(mark, 0, at) for mark in (b" ", b",", b"\n", b"[", b":")) + 1
        length = next((i for i, c in enumerate(content[start:]) if c in b" ,\r\n]"), len(content) - start)
        return content[:start] + str(generator.choice(WORDS)).encode() + content[start + length :]
    match generator.integers(7):
        case 0:
            return before + bytes([content[at] ^ (1 << int(generator.integers(8)))]) + content[at + 1 :]
        case 1:
            return before
        case 2:
            return before + bytes(len(middle)) + after
        case 3:
            return before + middle + middle + after
        case 4:
            return before + after + middle
        case 5:
            width, order = int(generator.choice([2, 4, 8])), ("little", "big")[generator.integers(2)]
            value = int(generator.choice(np.array(EXTREMES, object))) % 2 ** (8 * width)
            return before + value.to_bytes(width, order) + content[at + width :]
        case _:
            return before + bytes(generator.integers(0, 256, len(middle), np.uint8)) + after


def serve(pipe: Connection) -> None:
    """The reading process: makes the files of kind after kind, and reads them as often as it is asked to."""
    import resource

    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries say of damaged files
    sys.path.insert(0, str(SUPPORT))
    from every_file import KINDS

    from sips_lit.errors import BadInputError

    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (HARD_LIMIT, HARD_LIMIT))
    kinds = {kind.name: kind for kind in KINDS}
    pipe.send(list(kinds))
    while True:
        name, folder, file = pipe.recv()
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory counts from here
        try:
            if file is None:
                kinds[name].make(folder)
                files = [path for path in sorted(folder.glob(kinds[name].files)) if path.is_file()]
                for path in files:
                    kinds[name].read(folder, path)
                pipe.send(files)
                continue
            kinds[name].read(folder, file)
            answer = ("read", "")
        except BadInputError as error:
            answer = ("refused", str(error))
        except BaseException:
            answer = ("FAILED", traceback.format_exc())
        peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
        pipe.send((*answer, 1024 * int(peak.split()[1])))


class Reader:
    """The reading process, started again when it dies."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()
        self.kinds: list[str] = self.pipe.recv()

    def make(self, kind: str, folder: Path) -> list[Path]:
        self.pipe.send((kind, folder, None))
        files = self.pipe.recv()
        if not isinstance(files, list):
            sys.exit(f"the undamaged {kind} can't be read: {files[1]}")
        return files

    def read(self, kind: str, folder: Path, file: Path) -> tuple[str, str, int]:
        """How reading went, what was said, and the peak of memory in bytes."""
        self.pipe.send((kind, folder, file))
        try:
            if self.pipe.poll(SECONDS):
                return self.pipe.recv()
            outcome = ("HUNG", f"longer than {SECONDS:g} s", 0)
        except EOFError:
            self.process.join()
            outcome = ("CRASHED", f"exit code {self.process.exitcode}", 0)
        self.process.kill()
        self._start()
        return outcome


@dataclass
class Figures:
    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    peak: int = 0

    def __add__(self, other: Figures) -> Figures:
        peak, slowest = max(self.peak, other.peak), max(self.slowest, other.slowest)
        return Figures(self.outcomes + other.outcomes, slowest, peak)

    @property
    def failed(self) -> bool:
        return any(outcome.isupper() for outcome in self.outcomes)

    def __str__(self) -> str:
        bad = ", ".join(f"{n} {what}" for what, n in sorted(self.outcomes.items()) if what.isupper())
        good = f"{self.outcomes['read']:6} {self.outcomes['refused']:8} {self.slowest:9.2f} {self.peak / 1e6:8.0f}"
        return f"{sum(self.outcomes.values()):6} {good}  {bad or '-'}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=10_000, help="mutated files in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="*", help="kinds whose name matches")
    parser.add_argument("--keep", type=Path, help="a folder for the files that failed")
    given = parser.parse_args()
    reader, total = Reader(), Figures()
    kinds = fnmatch.filter(reader.kinds, given.only)
    print(f"{'kind':24} {'files':>6} {'read':>6} {'refused':>8} {'slowest s':>9} {'peak MB':>8}  failed")
    for number, kind in enumerate(kinds):
        share = given.files * (number + 1) // len(kinds) - given.files * number // len(kinds)
        figures = damage(reader, kind, share, given.seed, given.keep)
        total += figures
        print(f"{kind:24} {figures}", flush=True)
    print(f"{'all':24} {total}")
    return int(total.failed)


def damage(reader: Reader, kind: str, count: int, seed: int, keep: Path | None) -> Figures:
    """Reads ``count`` mutations of the files of a kind, and prints what failed."""
    figures = Figures()
    with tempfile.TemporaryDirectory() as place:
        whole, work = Path(place) / "whole", Path(place) / "work"
        whole.mkdir()
        files = [file.relative_to(whole) for file in reader.make(kind, whole)]
        for at in range(count):
            generator = np.random.default_rng([seed, *kind.encode(), at])
            file = files[generator.integers(len(files))]
            shutil.copytree(whole, work)
            (work / file).write_bytes(mutated((whole / file).read_bytes(), generator))
            begin = time.monotonic()
            outcome, said, peak = reader.read(kind, work, work / file)
            outcome = "OVER MEMORY" if peak > MEMORY else outcome
            outcome = "MORE THAN A SENTENCE" if outcome == "refused" and not said.isprintable() else outcome
            figures += Figures(Counter([outcome]), time.monotonic() - begin, peak)
            if outcome.isupper():
                print(f"--- {kind}, mutation {at} of {file}: {outcome}\n{said.strip()}")
                if keep is not None:
                    shutil.copytree(work, keep / f"{kind}-{at}-{file.name}")
            shutil.rmtree(work)
    return figures


if __name__ == "__main__":
    sys.exit(main())
