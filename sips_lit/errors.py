"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1. And warnings alike."""

from __future__ import annotations

import importlib
import warnings
from typing import Any


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do."""


class TrainingInterrupted(Exception):  # noqa: N818 - not an error: the user asked for it
    """Training stopped on request; the message says where it was saved."""


class InputWarning(UserWarning):
    """Something given is usable, but not all of it, or not in the way that one may expect."""


def warn_input(message: str) -> None:
    """Warns of an input; the commands print it once, as one sentence."""
    warnings.warn(message, InputWarning, stacklevel=3)


def import_extra(module: str, extra: str, needed_by: str) -> Any:
    """A module that the extra installs. Raises BadInputError where it is missing; ``needed_by`` says who needs it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise BadInputError(f"{needed_by} needs the package {package}: pip install 'sips_lit[{extra}]'") from error
