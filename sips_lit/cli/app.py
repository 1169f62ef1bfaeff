"""What all commands share: where the configuration is, and errors as one sentence with a non-zero exit."""

from __future__ import annotations

import errno
import logging
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Never, TypeVar, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException, InstantiationException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import (
    InterpolationToMissingValueError,
    MissingMandatoryValue,
    OmegaConfBaseException,
    ValidationError,
)

from sips_lit.cli.arguments import as_typed
from sips_lit.cli.value_types import refuse_wrong_types
from sips_lit.errors import BadInputError, InputWarning, TrainingInterrupted
from sips_lit.files import FULL, LONGEST_NAME, disk_of, unwritten

PACKAGE = Path(__file__).resolve().parents[1]
CONF_DIR = PACKAGE / "conf" if (PACKAGE / "conf").is_dir() else PACKAGE.parent / "conf"  # in a wheel, in a clone
INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM  # as a shell has it
# what a constructor raises for values that it can't take; by name, since not every command loads Lightning
MISCONFIGURED = "MisconfigurationException"
REFUSED = ("TypeError", "ValueError", MISCONFIGURED)
Options = TypeVar("Options")
ALMOST_FULL = 1 << 20  # bytes: what failed to be written may have been more than a block
_LOST_WORKER = re.compile(r"DataLoader worker .*(killed|exited unexpectedly)")


def run(config_name: str, task: Callable[[DictConfig], Any]) -> None:
    """Runs a command: composes ``conf/<config_name>.yaml`` with the command line and calls ``task`` with it.

    Bad input ends in one sentence on standard error and exit code 1, Ctrl-C in exit code 130, SIGTERM in 143. A job of a
    multirun that fails does not stop the others.
    """
    logging.raiseExceptions = False  # a disk that is full is told once, not with a traceback for each line of the log
    register_resolvers()
    quiet_lightning()
    try:
        sys.argv[1:] = as_typed(sys.argv[1:])
    except BadInputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)

    begun = False

    def command(config: DictConfig) -> Any:
        nonlocal begun
        begun = True
        register_resolvers()  # a launcher may have started another process
        quiet_lightning()
        with errors_explained(config):
            return task(config)

    command.__module__, command.__qualname__ = __name__, config_name
    with _errors_of_hydra():
        try:
            hydra.main(version_base="1.3", config_path=str(CONF_DIR), config_name=config_name)(command)()
        except Exception as error:
            if begun or isinstance(error, CompactHydraException) or getattr(error, "errno", None) is not None:
                raise
            why = " ".join(str(error).split())
            raise BadInputError(f"a file of the configuration can't be read: {why}") from error


@contextmanager
def _errors_of_hydra() -> Iterator[None]:
    """What Hydra raises ends as it prints it, but a folder or log of the run that can't be written in one sentence."""
    name = "HYDRA_FULL_ERROR"
    asked = os.environ.get(name)
    os.environ[name] = "1"  # else Hydra prints a traceback of its own
    try:
        yield
    except BrokenPipeError:
        _leave_pipe()
    except Exception as error:
        sentence = None if isinstance(error, CompactHydraException) else explain(error)
        if asked:
            raise
        if sentence is not None:
            print(f"error: {sentence}", file=sys.stderr)
        elif isinstance(error, CompactHydraException):
            told = [error, error.__cause__] if isinstance(error.__cause__, OmegaConfBaseException) else [error]
            print(*told, sep="\n", file=sys.stderr)
        else:
            traceback.print_exc()
        sys.exit(1)
    finally:
        os.environ.pop(name)
        if asked is not None:
            os.environ[name] = asked


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


def quiet_lightning() -> None:
    """Leaves out what Lightning says of the hardware and of itself."""
    warnings.filterwarnings("ignore", module="lightning")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


@contextmanager
def errors_explained(config: DictConfig | None = None) -> Iterator[None]:
    """Ends the program as `run` says; ``config`` is that of a Hydra command. OpenCV's own lines about damaged images go."""
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
        _leave_pipe()
    except SystemExit as stop:
        if stop.code == TERMINATED:
            print("terminated", file=sys.stderr)
        # what Lightning makes of a Ctrl-C during a fit
        sys.exit(INTERRUPTED if isinstance(stop.__context__, KeyboardInterrupt) else stop.code)
    except Exception as error:
        sentence = explain(error, config)
        if sentence is None:
            raise
        print(f"error: {sentence}", file=sys.stderr)
        if isinstance(error, TrainingInterrupted):
            sys.exit(128 + error.number)
        if config is not None and HydraConfig.get().mode == RunMode.MULTIRUN:
            raise JobFailed(f"a job failed: {sentence}") from None  # an exit would end the jobs that are to come
        sys.exit(1)


@contextmanager
def signals_heard() -> Iterator[None]:
    """Makes SIGTERM an exit, which cleans up; gives the signals back as they were, whatever a training made of them.

    After a stop by a signal SIGTERM stays ignored: the program ends anyway, and schedulers send it twice.
    """
    if threading.current_thread() is not threading.main_thread():  # only there can it be
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except BaseException as error:
        if isinstance(error, TrainingInterrupted) or (isinstance(error, SystemExit) and error.code == TERMINATED):
            before[signal.SIGTERM] = signal.SIG_IGN
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _terminate(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)
    if HydraConfig.initialized() and HydraConfig.get().job.name.startswith("train_ddp_process_"):
        os.kill(os.getppid(), number)  # of several processes of a training: the one that launched this ends all
    else:
        sys.exit(128 + number)


def _leave_pipe() -> Never:
    """Ends without a word, as others do whose reader has seen enough (``| head``)."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is flushed at the end
    sys.exit(128 + signal.SIGPIPE)


class JobFailed(CompactHydraException):
    """What a job of a multirun ends with; Hydra prints the message, without a traceback, after the last job."""


def _only_defects(failed: threading.ExceptHookArgs) -> None:
    """A thread that can't write (the log's) prints nothing: the error comes again where its result is asked for."""
    if not isinstance(failed.exc_value, OSError):
        threading.__excepthook__(failed)


def build(node: DictConfig, **extra: Any) -> Any:
    """What a node of the configuration describes; ``extra`` adds constructor arguments.

    Raises BadInputError for a value of the wrong type.
    """
    refuse_wrong_types(node)
    return hydra.utils.instantiate(node, _convert_="all", **extra)


def typed(config: DictConfig, options: type[Options]) -> Options:
    """The configuration of a command of plain keys, as an instance of the dataclass ``options``, which has the same keys.

    Raises BadInputError for a value of the wrong type, MissingMandatoryValue for a key that is not set.
    """
    for key in sorted(OmegaConf.missing_keys(config)):
        OmegaConf.select(config, key, throw_on_missing=True)
    try:
        return cast(Options, OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(options), config)))
    except ValidationError as error:
        raise BadInputError(f"{error.full_key} has a value of the wrong type: {str(error).splitlines()[0]}") from error


def register_resolvers() -> None:
    """Makes ``${fast_precision:}`` known to the configuration."""
    OmegaConf.register_new_resolver("fast_precision", fast_precision, replace=True)


def fast_precision() -> str:
    """``bf16-mixed`` where the hardware multiplies bfloat16 faster than float32, else ``32-true``.

    Of CPUs only those with AMX do for convolutions: with AVX512_BF16 alone a step took 1.1 to 1.5 times as long.
    """
    import torch

    if torch.cuda.is_available():
        return "bf16-mixed" if torch.cuda.is_bf16_supported() else "32-true"
    return "bf16-mixed" if "amx_bf16" in cpu_flags() else "32-true"


def cpu_flags() -> str:
    """The first processor's feature flags on Linux; empty elsewhere."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    return next((line for line in lines if line.startswith("flags")), "")


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
        if isinstance(cause, InstantiationException) and type(cause.__cause__).__name__ in REFUSED:
            where = re.search(r"full_key: (\S+)", str(cause))
            return f"{where[1] if where else 'the configuration'} can't be made: {cause.__cause__}"
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
