"""What all commands share: where the configuration is, and errors as one sentence with a non-zero exit."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable
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


def run(config_name: str, task: Callable[[DictConfig], Any]) -> None:
    """Runs a command: composes ``conf/<config_name>.yaml`` with the command line and calls ``task`` with it.

    Bad input ends in one sentence on standard error and exit code 1, Ctrl-C in exit code 130.
    """
    warnings.filterwarnings("ignore", module="lightning")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    register_resolvers()

    def command(config: DictConfig) -> Any:
        try:
            return task(config)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(INTERRUPTED)
        except Exception as error:
            sentence = explain(error)
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


def explain(error: BaseException) -> str | None:
    """One sentence if the error, or what caused it, is the user's to mend; None if it is a defect of the program."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, BadInputError | TrainingInterrupted):
            return str(cause)
        if isinstance(cause, MissingMandatoryValue | InterpolationToMissingValueError):
            key = str(cause.full_key or cause).removeprefix("Missing mandatory value: ")
            source = _missing_key(str(cause)) or key
            return f"{source} is not set: add {source}=... to the command"
        if isinstance(cause, OSError) and cause.errno == 28:
            return f"the disk is full: free some space, or write elsewhere ({cause.filename or 'hydra.run.dir=...'})"
        cause = cause.__cause__ or (cause.__context__ if isinstance(cause, InstantiationException) else None)
    return None


def _missing_key(message: str) -> str | None:
    """The key that an interpolation ended at: 'MissingMandatoryValue ... ${data.path} ...' names it."""
    start = message.find("${")
    return message[start + 2 : message.find("}", start)] if start >= 0 else None
