"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1. And warnings alike."""

from __future__ import annotations

import importlib
import re
import signal
import warnings
from typing import Any

LONGEST_WORD = 1000  # characters: a path is rarely as long


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do.

    It stays one line for the terminal, whatever is quoted from a file: control characters are escaped, endless words cut.
    """

    def __init__(self, message: str) -> None:
        super().__init__(_on_one_line(message))


class StorageError(BadInputError):
    """What has to be kept can't be written: a full disk, no permission. No other input would be better."""


class TrainingInterrupted(Exception):  # noqa: N818 - not an error: the user asked for it
    """Training stopped on request; the message says where it was saved. ``number``: of the signal that asked."""

    def __init__(self, message: str, number: int = signal.SIGINT) -> None:
        super().__init__(message, number)
        self.number = number

    def __str__(self) -> str:
        return str(self.args[0])


class InputWarning(UserWarning):
    """Something given is usable, but not all of it, or not in the way that one may expect."""


class LeftOutWarning(InputWarning):
    """A whole recording can't be read, and the others are used without it."""


def warn_input(message: str, category: type[InputWarning] = InputWarning) -> None:
    """Warns of an input; the commands print it once, as one sentence."""
    warnings.warn(_on_one_line(message), category, stacklevel=3)


def import_extra(module: str, extra: str, needed_by: str) -> Any:
    """A module that the extra installs. Raises BadInputError where it is missing; ``needed_by`` says who needs it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise BadInputError(f"{needed_by} needs the package {package}: pip install 'sips_lit[{extra}]'") from error


def _on_one_line(message: str) -> str:
    escaped = "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)
    return re.sub(rf"(\S{{{LONGEST_WORD // 2}}})\S{{{LONGEST_WORD // 2},}}", r"\1...", escaped)
