"""What all commands share: where the configuration is, and errors as one sentence with a non-zero exit."""

from __future__ import annotations

import errno
import logging
import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import hydra
from hydra.errors import InstantiationException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue

from sips_lit.errors import BadInputError, TrainingInterrupted

PACKAGE = Path(__file__).resolve().parents[1]
CONF_DIR = PACKAGE / "conf" if (PACKAGE / "conf").is_dir() else PACKAGE.parent / "conf"  # in a wheel, in a clone
INTERRUPTED = 130
# what a constructor raises for values that it can't take; by name, since not every command loads Lightning
REFUSED = ("TypeError", "ValueError", "MisconfigurationException")
_LOST_WORKER = re.compile(r"DataLoader worker .*(killed|exited unexpectedly)")


def run(config_name: str, task: Callable[[DictConfig], Any]) -> None:
    """Runs a command: composes ``conf/<config_name>.yaml`` with the command line and calls ``task`` with it.

    Bad input ends in one sentence on standard error and exit code 1, Ctrl-C in exit code 130.
    """
    warnings.filterwarnings("ignore", module="lightning")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    register_resolvers()

    def command(config: DictConfig) -> Any:
        register_resolvers()  # a launcher may have started another process
        try:
            return task(config)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(INTERRUPTED)
        except SystemExit as stop:
            # what Lightning makes of a Ctrl-C during a fit
            sys.exit(INTERRUPTED if isinstance(stop.__context__, KeyboardInterrupt) else stop.code)
        except Exception as error:
            sentence = explain(error, keys_not_set(config))
            if sentence is None:
                raise
            print(f"error: {sentence}", file=sys.stderr)
            sys.exit(INTERRUPTED if isinstance(error, TrainingInterrupted) else 1)

    command.__module__, command.__qualname__ = __name__, config_name
    hydra.main(version_base="1.3", config_path=str(CONF_DIR), config_name=config_name)(command)()


def build(node: DictConfig, **extra: Any) -> Any:
    """What a node of the configuration describes; ``extra`` adds constructor arguments."""
    return hydra.utils.instantiate(node, _convert_="all", **extra)


def register_resolvers() -> None:
    """Makes ``${fast_precision:}`` known to the configuration."""
    OmegaConf.register_new_resolver("fast_precision", fast_precision, replace=True)


def fast_precision() -> str:
    """``bf16-mixed`` where the hardware multiplies bfloat16 faster than float32, else ``32-true``."""
    import torch

    if torch.cuda.is_available():
        return "bf16-mixed" if torch.cuda.is_bf16_supported() else "32-true"
    capable = torch.backends.cpu.get_cpu_capability() == "AVX512" and "avx512_bf16" in cpu_flags()
    return "bf16-mixed" if capable else "32-true"


def cpu_flags() -> str:
    """The first processor's feature flags on Linux; empty elsewhere."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    return next((line for line in lines if line.startswith("flags")), "")


def explain(error: BaseException, missing: Collection[str] = ()) -> str | None:
    """One sentence if the error, or what caused it, is the user's to mend; None if it is a defect of the program.

    ``missing`` are the keys of the configuration that are not set: an error may know one by where it is used only.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, BadInputError | TrainingInterrupted):
            return str(cause)
        if isinstance(cause, MissingMandatoryValue | InterpolationToMissingValueError):
            key = _missing_key(str(cause), str(cause.full_key or ""), missing)
            return f"{key} is not set: add {key}=... to the command"
        if isinstance(cause, InstantiationException) and type(cause.__cause__).__name__ in REFUSED:
            where = re.search(r"full_key: (\S+)", str(cause))
            return f"{where[1] if where else 'the configuration'} can't be made: {cause.__cause__}"
        if isinstance(cause, RuntimeError) and _LOST_WORKER.search(str(cause)):
            return (
                "a loading worker was killed (for want of memory?): try datamodule.loading_workers=0, or smaller images"
            )
        if isinstance(cause, OSError) and cause.errno == errno.ENOSPC:
            return f"the disk is full: free some space, or write elsewhere ({cause.filename or 'hydra.run.dir=...'})"
        cause = cause.__cause__ or (cause.__context__ if isinstance(cause, InstantiationException) else None)
    return None


def keys_not_set(config: DictConfig) -> list[str]:
    """Keys whose value is ``???``, not those that only refer to one (`OmegaConf.missing_keys` fails there)."""

    def search(node: Any, key: str) -> Iterator[str]:
        if isinstance(node, dict):
            for name, value in node.items():
                yield from search(value, f"{key}.{name}" if key else str(name))
        elif node == "???":
            yield key

    return list(search(OmegaConf.to_container(config, resolve=False), ""))


def _missing_key(message: str, used_as: str, missing: Collection[str]) -> str:
    """The key that the user has to set: the message names it, or where it ends up (``datamodule.data.path``)."""
    named = re.search(r"Missing mandatory value: (\S+)|\$\{([^}]+)\}", message)
    key = (named[1] or named[2]) if named else used_as
    return min((k for k in missing if f".{key}".endswith(f".{k}")), default=key, key=len)
