"""Mutation testing: does a test fail when a line of the package is wrong? python benchmarks/mutants.py [--only PATTERN]

The mutants are in ``benchmarks/mutants/*.yaml``: by file of the package a list of ``what`` is wrong, the exact ``old`` text,
which must occur once, the ``new`` text, and, where the file's own tests (``a/b.py``: ``a/test_b.py``, ``a/test_b_*.py``) are
not those that should notice, ``tests``. Each mutant is made in a copy of package and tests, so the checkout stays as it is.
Prints what happened to each and exits with 1 if any survives or does not fit the package any more.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
TABLES = Path(__file__).parent / "mutants"
COPIED = ("sips_lit", "hydra_plugins", "conf", "tests", "benchmarks", "pyproject.toml")
TIMEOUT = 300  # seconds for the tests of a mutant: longer is an endless loop
PASSED, FAILED = 0, 1  # pytest's exit codes; others mean that no test ran to its end
FORKS = multiprocessing.get_context("forkserver")  # with libraries loaded: most of the time of a short test is theirs
LIBRARIES = ["pytest", "hypothesis", "torch", "torchmetrics", "lightning", "cv2", "matplotlib.figure"]


@dataclass(frozen=True, slots=True)
class Mutant:
    """``old`` becomes ``new`` in a file of the package; ``tests`` are files below ``tests/``."""

    file: str
    what: str
    old: str
    new: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.file}: {self.what}"


def own_tests(file: str) -> tuple[str, ...]:
    """The files below ``tests/`` that are called after a file of the package, or begin so."""
    folder, stem = Path(file).parent, Path(file).stem
    found = [f"test_{stem}.py", *sorted(path.name for path in (ROOT / "tests" / folder).glob(f"test_{stem}_*.py"))]
    return tuple(str(folder / name) for name in found)


def read_tables() -> list[Mutant]:
    mutants = []
    for table in sorted(TABLES.glob("*.yaml")):
        for file, entries in yaml.safe_load(table.read_text()).items():
            own = own_tests(file)
            for entry in entries:
                tests = tuple(entry.get("tests", "").split()) or own
                mutants.append(Mutant(file, entry["what"], entry["old"], entry["new"], tests))
    return mutants


@contextmanager
def copy_of_checkout() -> Iterator[Path]:
    """A folder with package and tests that is gone afterwards; a new one for each mutant, so no bytecode is stale."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        for name in COPIED:
            source, target = ROOT / name, Path(folder) / name
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, target)
        yield Path(folder)


def run_tests(folder: Path, tests: tuple[str, ...]) -> int | None:
    """Exit code of pytest in a copy, None if it took too long."""
    process = FORKS.Process(target=pytest_in, args=(folder, tests))
    process.start()
    process.join(TIMEOUT)
    if process.is_alive():
        process.kill()
        process.join()
        return None
    return process.exitcode


def pytest_in(folder: Path, tests: tuple[str, ...]) -> None:
    """Runs tests of a copy and ends the process; nothing of the package was imported before."""
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    os.environ["PYTHONPATH"] = str(folder)  # for commands that tests start
    for name in ("PYTEST_ADDOPTS", "PYTEST_PLUGINS"):  # options of plugins that are not loaded
        os.environ.pop(name, None)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # finding and loading plugins takes longer than the tests
    gc.freeze()  # pytest collects garbage twice at its end: the libraries are none
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    import pytest

    import sips_lit

    assert Path(sips_lit.__file__).is_relative_to(folder)
    options = ["-o", "addopts=--import-mode=importlib", "-x", "-q", "-p", "no:cacheprovider"]  # in this process
    sys.exit(pytest.main([*options, *(f"tests/{test}" for test in tests)]))


def untouched(tests: tuple[str, ...]) -> int | None:
    """What the tests say of the package as it is."""
    with copy_of_checkout() as folder:
        return run_tests(folder, tests)


def fate(mutant: Mutant) -> tuple[str, float]:
    """``killed``, ``SURVIVED``, or ``BROKEN`` where its text does not occur once or the tests cannot run; seconds."""
    begin = time.perf_counter()
    with copy_of_checkout() as folder:
        path = folder / "sips_lit" / mutant.file
        text = path.read_text() if path.is_file() else ""
        if text.count(mutant.old) != 1:
            return "BROKEN", 0.0
        path.write_text(text.replace(mutant.old, mutant.new))
        code = run_tests(folder, mutant.tests)
    killed = code is None or code == FAILED
    word = "killed" if killed else "SURVIVED" if code == PASSED else "BROKEN"
    return word, time.perf_counter() - begin


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="PATTERN", default="", help="mutants whose 'file: what' holds this regex")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time")
    parser.add_argument("--list", action="store_true", help="print the mutants and run nothing")
    options = parser.parse_args()
    mutants = [mutant for mutant in read_tables() if re.search(options.only, str(mutant))]
    if not mutants:
        parser.error(f"no mutant matches {options.only}")
    if options.list:
        print(*mutants, sep="\n")
        return 0
    FORKS.set_forkserver_preload(LIBRARIES)
    with ThreadPoolExecutor(options.jobs) as pool:
        suites = sorted({mutant.tests for mutant in mutants})
        for suite, code in zip(suites, pool.map(untouched, suites), strict=True):
            if code != PASSED:
                print(f"{' '.join(suite)} must pass before anything is changed (pytest's exit code is {code})")
                return 1
        counts = {"killed": 0, "SURVIVED": 0, "BROKEN": 0}
        for mutant, (word, seconds) in zip(mutants, pool.map(fate, mutants), strict=True):
            counts[word] += 1
            print(f"{word:9}{seconds:6.1f} s  {mutant}", flush=True)
    print(", ".join(f"{count} {word.lower()}" for word, count in counts.items()), f"of {len(mutants)} mutants")
    return int(counts["killed"] < len(mutants))


if __name__ == "__main__":
    sys.exit(main())
