"""What all commands share: from the command line and the configuration to a task, and back to an exit code."""

from __future__ import annotations

import logging
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException
from hydra.types import RunMode
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException, ValidationError

from sips_lit.cli.arguments import as_typed, with_keys
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.explain import explain, explained
from sips_lit.cli.help import answered
from sips_lit.cli.keys import explain_composition, own_keys, plain_config
from sips_lit.cli.next_steps import told
from sips_lit.cli.options import refuse_options, sweep_first
from sips_lit.cli.run_log import log_file, logged
from sips_lit.cli.signals import leave_pipe
from sips_lit.cli.sweep_table import table_at_end
from sips_lit.cli.unread import refuse_unread
from sips_lit.cli.value_types import refuse_wrong_keys, refuse_wrong_types
from sips_lit.errors import BadInputError

Options = TypeVar("Options")

KEPT_OR_NOT: Final = frozenset({"indexes", "frames"})
"""Folders of ``paths`` that may be null where a command can do without: nothing is kept for the next time."""


def run(
    config_name: str,
    task: Callable[[DictConfig], Any],
    following: Callable[[DictConfig], Sequence[Sequence[str]]] | None = None,
) -> None:
    """Runs a command: composes ``conf/<config_name>.yaml`` with the command line and calls ``task`` with it.

    What the terminal says is also in the log of the run's folder. ``following``: commands that one may want next.
    Bad input ends in one sentence on standard error and exit code 1, Ctrl-C in exit code 130, SIGTERM in 143. A job of a
    multirun that fails does not stop the others. ``--help`` and ``--version`` are answered instead.
    """
    if answered(config_name, sys.argv[1:]):
        return
    logging.raiseExceptions = False  # a disk that is full is told once, not with a traceback for each line of the log
    register_resolvers()
    quiet_lightning()
    arguments = sweep_first(sys.argv[1:])
    try:
        arguments = with_keys(config_name, arguments)
        refuse_options(arguments, lambda: own_keys(plain_config(config_name, arguments)))
        sys.argv[1:] = as_typed(arguments)
    except BadInputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)

    begun = False

    def command(config: DictConfig) -> Any:
        nonlocal begun
        begun = True
        register_resolvers()  # a launcher may have started another process
        quiet_lightning()
        with logged(log_file()), explained(config):
            refuse_unread(config, config_name)
            paths = config.get("paths", {})
            refuse_wrong_keys(paths, {name: Path | None if name in KEPT_OR_NOT else Path for name in paths})
            result = task(config)
            if following is not None and log_file() is not None and HydraConfig.get().mode == RunMode.RUN:
                print(told(following(config)))
            return result

    command.__module__, command.__qualname__ = __name__, config_name
    with _errors_of_hydra(config_name, arguments), table_at_end(config_name):
        try:
            hydra.main(version_base="1.3", config_path=str(CONF_DIR), config_name=config_name)(command)()
        except Exception as error:  # a file that YAML can't parse makes Hydra raise almost anything
            if (
                begun
                or isinstance(error, CompactHydraException | BadInputError)
                or getattr(error, "errno", None) is not None
            ):
                raise
            why = " ".join(str(error).split())
            if _of_launcher(error):
                raise BadInputError(f"the launcher of the jobs (hydra.launcher) fails: {why}") from error
            raise BadInputError(f"a file of the configuration can't be read: {why}") from error


def _of_launcher(error: Exception) -> bool:
    """Whether a launcher, a package within `hydra_plugins`, was running, and was not composing its jobs."""
    files = [Path(frame.filename) for frame in traceback.extract_tb(error.__traceback__)]
    composing = any(file.name == "config_loader_impl.py" for file in files)
    return not composing and any("hydra_plugins" in file.parts[:-2] for file in files)


@contextmanager
def _errors_of_hydra(command: str, arguments: Sequence[str]) -> Iterator[None]:
    """What Hydra raises ends in one sentence if it is about a key, a folder or a log, else as Hydra prints it."""
    name = "HYDRA_FULL_ERROR"
    asked = os.environ.get(name)
    os.environ[name] = "1"  # else Hydra prints a traceback of its own
    try:
        yield
    except BrokenPipeError:
        leave_pipe()
    except Exception as error:  # told in a sentence, or with its traceback; either way the exit code is 1
        if asked:
            raise
        of_hydra = isinstance(error, CompactHydraException)
        sentence = explain_composition(error, command, arguments) if of_hydra else explain(error)
        if sentence is not None:
            print(f"error: {sentence}", file=sys.stderr)
        elif of_hydra:
            told = [error, error.__cause__] if isinstance(error.__cause__, OmegaConfBaseException) else [error]
            print(*told, sep="\n", file=sys.stderr)
        else:
            traceback.print_exc()
        sys.exit(1)
    finally:
        os.environ.pop(name)
        if asked is not None:
            os.environ[name] = asked


def quiet_lightning() -> None:
    """Leaves out what Lightning says of the hardware and of itself."""
    warnings.filterwarnings("ignore", module="lightning")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


def build(node: DictConfig | str | None, **extra: Any) -> Any:
    """What a node of the configuration describes; ``extra`` adds constructor arguments.

    Raises BadInputError for a value of the wrong type, and for a mere name.
    """
    if isinstance(node, str):
        raise BadInputError(
            f"the name {node!r} stands where a whole configuration belongs: choose it on the command line (inliers=klt), in "
            "an experiment's defaults (- override /inliers: klt), or there for a pair set alone "
            "(- /inliers@pair_sets.NAME.inliers: klt)"
        )
    refuse_wrong_types(node)
    return hydra.utils.instantiate(node, _convert_="all", **extra)


def typed(config: DictConfig, options: type[Options]) -> Options:
    """The configuration of a command of plain keys, as an instance of the dataclass ``options``, which has the same keys.

    Raises BadInputError for a value of the wrong type, MissingMandatoryValue for a key that is not set.
    """
    for key in sorted(OmegaConf.missing_keys(config)):
        OmegaConf.select(config, key, throw_on_missing=True)
    structured = OmegaConf.structured(options)
    for name, given in config.items():
        if isinstance(given, DictConfig) and isinstance(structured._get_node(name), ListConfig):
            raise BadInputError(f"{name!s} is {given}: give a list in square brackets, [1,2]")
    try:
        return cast(Options, OmegaConf.to_object(OmegaConf.merge(structured, config)))
    except ValidationError as error:
        reason = str(error).splitlines()[0]
        if "is not a ListConfig" in reason:
            value = OmegaConf.select(config, str(error.full_key))
            raise BadInputError(f"{error.full_key} is {value}: give a list in square brackets, [1,2]") from error
        raise BadInputError(f"{error.full_key} has a value of the wrong type: {reason}") from error


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
