"""A method of a benchmark: a detector with a descriptor, and everything that its features depend on."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch

from sips_lit.types import Descriptor, Detector

VERSION: Final = 2
"""Of the code that makes features: a higher one makes all stored features stale."""


@dataclass(frozen=True, slots=True)
class Method:
    """``descriptor`` None = the detector's own. ``key`` names files, ``name`` tables; ``signature`` tells stale features."""

    key: str
    name: str
    detector: Detector
    descriptor: Descriptor | None
    signature: Mapping[str, Any]
    checkpoint: str | None = None
    """The file of the detector's weights, in words; None where it names none."""

    @property
    def descriptor_name(self) -> str:
        """The descriptor's name, ``own`` for the detector's."""
        return "own" if self.descriptor is None else self.descriptor.name


def checkpoint_of(detector_config: Mapping[str, Any]) -> str | None:
    """The file of weights, or the name of released ones, that a detector's configuration gives, without its folder.

    A file comes with the beginning of its hash, as many are called ``last.ckpt``. None without any.
    """
    given = next((detector_config[key] for key in ("path", "weights") if detector_config.get(key)), None)
    if not isinstance(given, str):
        return None
    path = Path(given)
    return f"{path.name} (sha256 {hashlib.sha256(path.read_bytes()).hexdigest()[:12]})" if path.is_file() else path.name


def signature_of(
    detector: Detector, descriptor: Descriptor | None, detector_config: Any, descriptor_config: Any
) -> dict[str, Any]:
    """What features depend on: both configurations, the contents of files they name, weights, library versions.

    The configurations are plain (mappings, lists, numbers, texts), with everything resolved.
    """
    parts = [part for part in (detector, descriptor) if part is not None]
    return {
        "version": VERSION,
        "detector": _with_contents(detector_config),
        "descriptor": None if descriptor is None else _with_contents(descriptor_config),
        "weights": [weights_digest(part) for part in (detector, descriptor)],
        "code": [code_of(part) for part in parts],
        "versions": library_versions(),
    }


def library_versions() -> dict[str, str]:
    """Of the libraries that all numbers depend on."""
    return {"torch": torch.__version__, "opencv": cv2.__version__, "numpy": np.__version__}


def code_of(part: object) -> dict[str, str]:
    """Versions of the distribution that an object's class comes from and of what that requires.

    Of a class in no distribution (a module on the path, a script) a hash of its source file.
    """
    module = type(part).__module__
    own = _distributions(tuple(sys.path)).get(module.partition(".")[0], [])
    if not own:
        source = inspect.getsourcefile(type(part))
        return {module: "" if source is None else hashlib.sha256(Path(source).read_bytes()).hexdigest()[:32]}
    return dict(sorted({found for name in own for found in _versions(name)}))


@functools.cache
def _distributions(path: tuple[str, ...]) -> Mapping[str, list[str]]:
    """The distributions that packages come from; it takes half a second to read them all."""
    return importlib.metadata.packages_distributions()


def _versions(distribution: str) -> Iterator[tuple[str, str]]:
    """Names and versions of a distribution and of its requirements, extras included, as far as they are installed."""
    yield distribution, importlib.metadata.version(distribution)
    for requirement in importlib.metadata.requires(distribution) or ():
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            yield name, importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue


def weights_digest(part: object) -> str | None:
    """A hash of the weights of all networks that an object holds itself; None without any."""
    networks = [value for value in getattr(part, "__dict__", {}).values() if isinstance(value, torch.nn.Module)]
    if not networks:
        return None
    digest = hashlib.sha256()
    for network in networks:
        for name, tensor in network.state_dict().items():
            digest.update(f"{name}{tuple(tensor.shape)}{tensor.dtype}".encode())
            digest.update(tensor.detach().cpu().contiguous().flatten().view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()[:32]


def _with_contents(node: Any) -> Any:
    """The configuration with what a path leads to in place of the path: moving a file makes no difference."""
    if isinstance(node, Mapping):
        return {str(key): _with_contents(value) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_with_contents(value) for value in node]
    if isinstance(node, str) and 0 < len(node) < 1024:
        path = Path(node)
        if path.is_file():
            return f"content {hashlib.sha256(path.read_bytes()).hexdigest()[:32]}"
        if path.is_dir():
            files = sorted(file for file in path.rglob("*") if file.is_file())
            stats = [(str(file.relative_to(path)), file.stat().st_size, file.stat().st_mtime_ns) for file in files]
            return f"files {hashlib.sha256(repr(stats).encode()).hexdigest()[:32]}"
    return node
