"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1. And warnings alike."""

from __future__ import annotations

import signal
import warnings


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do."""


class TrainingInterrupted(Exception):  # noqa: N818 - not an error: the user asked for it
    """Training stopped on request; the message says where it was saved. ``number``: of the signal that asked."""

    def __init__(self, message: str, number: int = signal.SIGINT) -> None:
        super().__init__(message, number)
        self.number = number

    def __str__(self) -> str:
        return str(self.args[0])


class InputWarning(UserWarning):
    """Something given is usable, but not all of it, or not in the way that one may expect."""


def warn_input(message: str) -> None:
    """Warns of an input; the commands print it once, as one sentence."""
    warnings.warn(message, InputWarning, stacklevel=3)
