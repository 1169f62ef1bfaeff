"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1."""

import importlib
from typing import Any


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do."""


class TrainingInterrupted(Exception):  # noqa: N818 - not an error: the user asked for it
    """Training stopped on request; the message says where it was saved."""


def import_extra(module: str, extra: str, needed_by: str) -> Any:
    """A module that the extra installs. Raises BadInputError where it is missing; ``needed_by`` says who needs it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise BadInputError(f"{needed_by} needs the package {package}: pip install 'sips_lit[{extra}]'") from error
