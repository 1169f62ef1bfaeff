"""Values of the configuration that are of another type than what takes them says."""

from __future__ import annotations

import inspect
import math
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any

from hydra.utils import get_object
from omegaconf import DictConfig, ListConfig, OmegaConf

from sips_lit.errors import BadInputError

OURS = "sips_lit."
OTHERS = ("lightning.", "torch.")
LOOKED_AT = (OURS, *OTHERS)  # what is named there says what it takes; what else there is may say no types
WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "text", Path: "a path"}


def refuse_wrong_types(node: Any) -> None:
    """Raises BadInputError for the first number, switch, text or part in ``node`` that is none.

    Looks at what the classes and functions that it names, at any depth, take as int, float, bool, text or path, and as one
    of our classes; what others than ours, Lightning's and PyTorch's take, they check.
    """
    if isinstance(node, ListConfig):
        for item in node:
            refuse_wrong_types(item)
    if not isinstance(node, DictConfig):
        return
    own = {"_target_": str | None, "_partial_": bool}
    refuse_wrong_keys(node, {name: annotation for name, annotation in own.items() if name in node})
    target = OmegaConf.select(node, "_target_", default=None)
    expected = _annotations(target) if isinstance(target, str) and target.startswith(LOOKED_AT) else {}
    for name in node:
        if OmegaConf.is_missing(node, name):
            continue
        value = node[name]
        if isinstance(value, DictConfig | ListConfig):
            refuse_wrong_types(value)
        _refuse_other_than(expected.get(str(name)), node, str(name))


def refuse_wrong_keys(node: DictConfig, expected: Mapping[str, Any]) -> None:
    """Raises BadInputError for the first key of ``node`` whose value is not as ``expected``, annotations by name, says."""
    for name, annotation in expected.items():
        _refuse_other_than(annotation, node, name)


def _refuse_other_than(annotation: Any, node: DictConfig, name: str) -> None:
    wanted, value = _wanted(annotation), node[name]
    if wanted is not None and not _fits(value, *wanted):
        kind, optional, many = wanted
        word = WORDS.get(kind, f"a configuration, with _target_, of a {kind.__name__}")
        words = f"{'a list, each item ' if many else ''}{word}{', or null' if optional else ''}"
        raise BadInputError(f"{_full_key(node, name)} is {value}: give {words}")


def _annotations(target: str) -> dict[str, Any]:
    """The annotated arguments of a class or function; nothing for what can't be found, which Hydra tells better."""
    try:
        arguments = inspect.signature(get_object(target), eval_str=True).parameters
    except (ValueError, ImportError, NameError):
        return {}
    return {name: argument.annotation for name, argument in arguments.items()}


def _wanted(annotation: Any) -> tuple[type, bool, bool] | None:
    """The type, whether None is one, too, and whether there are many; None for annotations that are not looked at."""
    optional = False
    if isinstance(annotation, UnionType) or typing.get_origin(annotation) is typing.Union:
        parts = typing.get_args(annotation)
        optional = NoneType in parts
        others = [part for part in parts if part is not NoneType]
        as_path = set(others) == {str, Path}
        annotation = Path if as_path else others[0] if len(others) == 1 else None
    many = typing.get_origin(annotation) is Sequence
    if many:
        (annotation,) = typing.get_args(annotation)
    part = inspect.isclass(annotation) and annotation.__module__.startswith(OURS) and not many
    return (annotation, optional, many) if part or annotation in WORDS else None


def _fits(value: Any, kind: type, optional: bool, many: bool) -> bool:
    if value is None:
        return optional
    if many:
        return isinstance(value, ListConfig) and all(_fits(item, kind, False, False) for item in value)
    if kind in (str, Path):
        return not isinstance(value, DictConfig | ListConfig)
    if kind not in WORDS:
        return isinstance(value, DictConfig) and "_target_" in value
    if isinstance(value, bool):
        return kind is bool
    if isinstance(value, float) and not math.isfinite(value):
        return False
    return isinstance(value, (int, float) if kind is float else kind)


def _full_key(node: DictConfig, name: str) -> str:
    """Where the value stands that the user sets: interpolations are followed."""
    found = node._get_node(name)
    if found is not None and not isinstance(found, list):
        found = found._maybe_dereference_node()
    return str(node._get_full_key(name) if found is None else found._get_full_key(None))
