"""Where the installed commands start: questions are answered at once, what a run needs is loaded only for a run."""

from __future__ import annotations

import importlib
import sys
from functools import partial

from sips_lit.cli.help import answered

_OF_HYDRA = frozenset({"--cfg", "-c", "--hydra-help", "--info", "-i", "--shell-completion", "-sc"})


def start(command: str) -> None:
    """Runs ``sips-<command>``; torch takes seconds to load, so what only asks goes without."""
    arguments = sys.argv[1:]
    if answered(command, arguments):
        return
    if not _OF_HYDRA.isdisjoint(argument.partition("=")[0] for argument in arguments):
        from sips_lit.cli.app import run

        run(command, _nothing)
    else:
        importlib.import_module(f"sips_lit.cli.{command}").main()


def _nothing(config: object) -> None:
    """The task of a command that Hydra does not run."""


train = partial(start, "train")
index = partial(start, "index")
evaluate = partial(start, "evaluate")
benchmark = partial(start, "benchmark")
calibrate = partial(start, "calibrate")
detect = partial(start, "detect")
export = partial(start, "export")
speed = partial(start, "speed")
report = partial(start, "report")
match = partial(start, "match")
odometry = partial(start, "odometry")
