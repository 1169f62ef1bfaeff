"""Wrong values for every key: python benchmarks/wrong_values.py [COMMAND ...] [--values V ...] [--only PATTERN] [--sample N]

Each key of each command (train, evaluate, ...; without any: all of them) gets each value, in a short run on small images
that ``tests/support`` makes. A run must succeed or end in one sentence; prints every other end, and exits with 1 if there
is any. ``--sample`` takes so many of all these runs, drawn by ``--seed``. Left out: sips-data and sips-report, which take
files, and the keys of the trainer that start processes.
"""

from __future__ import annotations

import argparse
import contextlib
import fnmatch
import importlib
import io
import logging
import os
import random
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from tqdm import tqdm

from sips_lit.cli.app import register_resolvers
from sips_lit.cli.conf_files import CONF_DIR

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
VALUES = ("[a,b]", "{a: 1}", "text", "-1", "0", "nan", "1e400", "null", "true", "''")
ELSEWHERE = frozenset({"trainer.devices", "trainer.num_nodes", "trainer.strategy"})  # start processes of their own
DATA = ("data=folder", "data.path=frames")
WEIGHTS = "checkpoint=sips-tiny"


def bases() -> dict[str, list[str]]:
    """What each command gets besides the wrong value."""
    tiny = importlib.import_module("cli_runs").TINY
    evaluation = [*DATA, "pairs=2", "n_max=30", WEIGHTS]
    return {
        "train": [*tiny, *DATA],
        "evaluate": evaluation,
        "benchmark": [*evaluation, "detectors=[sips,orb]"],
        "calibrate": [*DATA, "pairs=2", WEIGHTS],
        "odometry": [*DATA, WEIGHTS],
        "index": [*DATA],
        "detect": ["input=frames", "n=20", WEIGHTS],
        "match": ["input=[frames/000.png,frames/001.png]", WEIGHTS],
        "export": [WEIGHTS],
        "speed": ["rounds=1", "images=1", "memory=false", "detectors=[orb]"],
    }


def keys_of(command: str, base: Sequence[str]) -> list[str]:
    """The keys of a command that hold single values, as one writes them; Hydra's are left out."""
    register_resolvers()
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return [key for key in _leaves(compose(command, list(base))) if key not in ELSEWHERE]


def _leaves(node: DictConfig, prefix: str = "") -> Iterator[str]:
    for name in node:
        child, key = node._get_node(name), f"{prefix}{name!s}"
        if isinstance(child, DictConfig) and not (child._is_none() or child._is_missing() or child._is_interpolation()):
            yield from _leaves(child, f"{key}.")
        else:
            yield key


def end_of(command: str, arguments: Sequence[str]) -> str | None:
    """How a run ended that neither succeeded nor said in one sentence why not; None where it did."""
    out, told, code = io.StringIO(), io.StringIO(), None
    root, argv = logging.getLogger(), sys.argv
    handlers, level = root.handlers[:], root.level
    sys.argv = [f"sips-{command}", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(told), warnings.catch_warnings():
            importlib.import_module(f"sips_lit.cli.{command}").main()
    except SystemExit as stop:
        code = stop.code
    except BaseException:  # whatever a command lets through
        return traceback.format_exc().splitlines()[-1]
    finally:
        sys.argv = argv
        root.handlers[:] = handlers
        root.setLevel(level)
        HydraConfig.instance().cfg = None
    lines = told.getvalue().splitlines()
    if any(line.startswith("Traceback") for line in lines):
        return lines[-1]
    sentences = [line for line in lines if line.startswith("error: ")]
    return None if code in (None, 0) or len(sentences) == 1 else f"exit {code}: {' '.join(lines[-3:])}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commands", nargs="*")
    parser.add_argument("--values", nargs="+", default=list(VALUES))
    parser.add_argument("--only", default="*", help="keys that match")
    parser.add_argument("--sample", type=int)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    sys.path.insert(0, str(SUPPORT))
    scene = importlib.import_module("textured_scenes").flight(14, size=(96, 80))

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        os.environ |= {"SIPS_LIT_DATA": f"{folder}/data", "SIPS_LIT_OUTPUTS": f"{folder}/outputs"}
        importlib.import_module("cli_runs").write_frames(Path("frames"), scene.frames)
        runs = [
            (command, [*base, f"{key}={value}"])
            for command, base in bases().items()
            if command in (options.commands or bases())
            for key in keys_of(command, base)
            if fnmatch.fnmatch(key, options.only)
            for value in options.values
        ]
        if options.sample is not None:
            runs = random.Random(options.seed).sample(runs, min(options.sample, len(runs)))
        failed = 0
        for command, arguments in tqdm(runs, unit="run", disable=None):
            end = end_of(command, arguments)
            if end is not None:
                failed += 1
                tqdm.write(f"FAILED sips-{command} {arguments[-1]}: {end}", file=sys.stdout)
    print(f"{len(runs)} runs, {failed} failed")
    sys.exit(min(failed, 1))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
