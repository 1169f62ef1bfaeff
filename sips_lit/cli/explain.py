"""Errors as one sentence: what went wrong in words, and a non-zero exit."""

from __future__ import annotations

import errno
import os
import re
import shutil
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException, InstantiationException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue

from sips_lit.cli.signals import INTERRUPTED, TERMINATED, leave_pipe, signals_heard
from sips_lit.cli.value_types import OTHERS
from sips_lit.errors import BadInputError, InputWarning, TrainingInterrupted
from sips_lit.files import FULL, LONGEST_NAME, disk_of, unwritten

# what a constructor raises for values that it can't take; by name, since not every command loads Lightning
MISCONFIGURED = "MisconfigurationException"
REFUSED = ("TypeError", "ValueError", MISCONFIGURED)
ALMOST_FULL = 1 << 20  # bytes: what failed to be written may have been more than a block
_LOST_WORKER = re.compile(r"DataLoader worker .*(killed|exited unexpectedly)")


class JobFailed(CompactHydraException):
    """What a job of a multirun ends with; Hydra prints the message, without a traceback, after the last job."""


def plain_warnings() -> None:
    """Prints each warning about the input once, as a sentence without the line of code that it comes from."""
    show = warnings.showwarning

    def sentence(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, InputWarning):
            print(f"warning: {message}", file=sys.stderr)
        else:
            show(message, category, *where, **more)

    warnings.showwarning = sentence
    warnings.simplefilter("once", InputWarning)


@contextmanager
def explained(config: DictConfig | None = None) -> Iterator[None]:
    """Ends the program as `app.run` says; ``config`` is that of a Hydra command.

    OpenCV's own lines about damaged images go.
    """
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    plain_warnings()
    threading.excepthook = _only_defects
    try:
        with signals_heard():
            yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        leave_pipe()
    except SystemExit as stop:
        if stop.code == TERMINATED:
            print("terminated", file=sys.stderr)
        # what Lightning makes of a Ctrl-C during a fit
        sys.exit(INTERRUPTED if isinstance(stop.__context__, KeyboardInterrupt) else stop.code)
    except Exception as error:  # what is not the user's to mend is raised on
        sentence = explain(error, config)
        if sentence is None:
            raise
        print(f"error: {sentence}", file=sys.stderr)
        if isinstance(error, TrainingInterrupted):
            sys.exit(128 + error.number)
        if config is not None and HydraConfig.get().mode == RunMode.MULTIRUN:
            raise JobFailed(f"a job failed: {sentence}") from None  # an exit would end the jobs that are to come
        sys.exit(1)


def _only_defects(failed: threading.ExceptHookArgs) -> None:
    """A thread that can't write (the log's) prints nothing: the error comes again where its result is asked for."""
    if not isinstance(failed.exc_value, OSError):
        threading.__excepthook__(failed)


def explain(error: BaseException, config: DictConfig | None = None) -> str | None:
    """One sentence if the error, or what caused it, is the user's to mend; None if it is a defect of the program.

    ``config`` tells where a value comes from that is not set: the error knows only where it is used.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, BadInputError | TrainingInterrupted):
            return str(cause)
        if isinstance(cause, MissingMandatoryValue | InterpolationToMissingValueError):
            named = re.search(r"Missing mandatory value: (\S+)", str(cause))
            plain = None if config is None else OmegaConf.to_container(config)
            key = origin(named[1] if named else str(cause.full_key), plain)
            return f"{key} is not set: add {key}=... to the command"
        if type(cause).__name__ == MISCONFIGURED:
            return str(cause)  # values that Lightning finds to fit the data or each other only when it has both
        if isinstance(cause, InstantiationException):
            where, why = re.search(r"full_key: (\S+)", str(cause)), type(cause.__cause__).__name__
            key = where[1] if where else "the configuration"
            gone = re.search(r"locating target '([^']*)'", str(cause))
            if gone:
                return f"{key}._target_ is {gone[1]}, which can't be imported: {_deepest(cause)}"
            called = re.search(r"call to target '([^']*)'", str(cause))
            # constructors of others say that they can't take a value by whatever it breaks first
            if why in REFUSED or (called and called[1].startswith(OTHERS)):
                return f"{key} can't be made: {cause.__cause__}"
            if "Expected a callable target" in str(cause):
                return f"{key}._target_ is no class or function: {str(cause).splitlines()[0]}"
        if isinstance(cause, RuntimeError) and _LOST_WORKER.search(str(cause)):
            return (
                "a loading worker was killed (for want of memory?): try datamodule.loading_workers=0, or smaller images"
            )
        if isinstance(cause, OSError) and cause.errno in FULL:
            return full_disk(cause, config)
        if isinstance(cause, OSError) and cause.errno is not None:
            file = "" if cause.filename is None else f"{os.fsdecode(cause.filename)}: "
            long = cause.errno == errno.ENAMETOOLONG
            hint = (
                f"the name of a file has at most {LONGEST_NAME} bytes"
                if long
                else "see to its permissions and its disk, or choose another place"
            )
            return f"{file}{cause.strerror}: {hint}"
        cause = cause.__cause__ or (cause.__context__ if isinstance(cause, InstantiationException) else None)
    return None


def _deepest(error: BaseException) -> BaseException:
    return error if error.__cause__ is None else _deepest(error.__cause__)


def full_disk(error: OSError, config: DictConfig | None) -> str:
    """Which disk is full: that of the file, or, where the error names none, those without space that a run writes to."""
    if isinstance(error.filename, str):
        return unwritten(Path(error.filename), error)
    if config is None:  # Hydra's own files, of which it tells no name
        given = (argument.rpartition("=")[2].strip("'\"") for argument in sys.argv[1:])
        paths = [*given, os.environ.get("SIPS_LIT_OUTPUTS", ".")]
    else:
        paths = [str(path) for path in config.get("paths", {}).values() if path]
    disks = {disk_of(Path(path)) for path in (*paths, tempfile.gettempdir())}
    full = ", ".join(sorted(str(disk) for disk in disks if shutil.disk_usage(disk).free < ALMOST_FULL))
    return f"the disk {full or 'of the outputs'} is full: free some space on it, or write elsewhere (hydra.run.dir=...)"


def origin(key: str, config: Any) -> str:
    """The key that the user sets for ``key``: where its interpolations lead, ``datamodule.data.path`` to ``data.path``.

    ``config`` is the plain one, with its interpolations.
    """
    node = config
    parts = key.split(".")
    for count, part in enumerate(parts, start=1):
        node = node.get(part) if isinstance(node, dict) else None
        reference = re.fullmatch(r"\$\{([\w.]+)\}", node) if isinstance(node, str) else None
        if reference:
            return origin(".".join([reference[1], *parts[count:]]), config)
    return key
