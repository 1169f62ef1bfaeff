"""``--help`` and ``--version``: what a command is for, examples, its keys. Answered before anything slow is loaded."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence
from typing import Final

from sips_lit.cli.conf_files import CONF_DIR, describe_key, head, options_of
from sips_lit.cli.signals import leave_pipe

WIDTH: Final = 100
"""Columns of a help text, at most."""
REQUIRED: Final = "required"
LONGEST_DEFAULT: Final = 16  # characters of a value that are shown
LONGEST_OPTIONS: Final = 50  # and of the options of a group

REST = """\
A key is written key=value, and a group of keys group=name. Add --cfg job to a command to see all of its keys and their
values without running it; the files in {conf} explain each. -m sweeps over a=1,2. Also: --version,
--shell-completion, --hydra-help."""


def answer(command: str, arguments: Sequence[str]) -> str | None:
    """What the arguments ask to be told instead of a run: the help or the version; None if they don't."""
    if not {"-h", "--help"}.isdisjoint(arguments):
        return help_text(command)
    return version_text(command) if "--version" in arguments else None


def answered(command: str, arguments: Sequence[str]) -> bool:
    """Whether the arguments asked for something that was told; prints it."""
    told = answer(command, arguments)
    if told is not None:
        try:
            print(told, flush=True)
        except BrokenPipeError:
            leave_pipe()
    return told is not None


def version_text(command: str) -> str:
    """The command and the version of the package."""
    from importlib.metadata import version

    return f"sips-{command} {version('sips_lit')}"


def help_text(command: str, width: int | None = None) -> str:
    """The help of a command, in up to ``WIDTH`` columns, from the comments of its file in ``conf/``."""
    columns = min(WIDTH, width or shutil.get_terminal_size((WIDTH, 40)).columns)
    top = head(command)
    rows = [(key, *_row(command, key)) for key in top.keys]
    lines = [*top.purpose, "", *(f"  {example}" for example in top.examples), ""]
    lines += _table(rows, columns)
    rest = REST.format(conf=CONF_DIR)
    return "\n".join([*lines, "", *textwrap.wrap(rest, columns, break_long_words=False, break_on_hyphens=False)])


def _row(command: str, key: str) -> tuple[str, str]:
    """The default and the comment of a key."""
    entry = describe_key(command, key)
    options = " | ".join(options_of(key))  # none, unless it is a group
    comment = ": ".join(part for part in (entry.comment, options if len(options) <= LONGEST_OPTIONS else "") if part)
    value = REQUIRED if entry.value == "???" else entry.value.strip("\"'")
    return (value if len(value) <= LONGEST_DEFAULT and "${" not in value else "", comment)


def _table(rows: Sequence[tuple[str, str, str]], columns: int) -> list[str]:
    """Keys, defaults and comments in three columns; a long comment goes on below itself."""
    widths = [max([len(row[i]) for row in rows], default=0) for i in (0, 1)]
    lines = []
    for key, value, comment in rows:
        begin = f"  {key:{widths[0]}}  {value:{widths[1]}}  "
        room = max(20, columns - len(begin))
        parts = textwrap.wrap(comment, room, break_on_hyphens=False) or [""]
        lines += [(begin if i == 0 else " " * len(begin)) + part for i, part in enumerate(parts)]
    return [line.rstrip() for line in lines]
