"""The data sets that are known: those of this package, and those that installed packages offer.

A package offers a data set by an entry point of the group ``sips_lit.datasets`` that leads to its `DatasetSpec`.
"""

from __future__ import annotations

import importlib
import pkgutil
from importlib.metadata import EntryPoint, entry_points

from sips_lit import datasets
from sips_lit.datasets.spec import DatasetSpec
from sips_lit.errors import BadInputError

GROUP = "sips_lit.datasets"


def find_specs() -> list[DatasetSpec]:
    """The data sets in the order in which they are tried: by rank, those of other packages before ours.

    Raises BadInputError for an entry point that can't be loaded, or leads to something else.
    """
    names = [f"{datasets.__name__}.{module.name}" for module in pkgutil.iter_modules(datasets.__path__)]
    ours = [spec for name in names if (spec := getattr(importlib.import_module(name), "SPEC", None))]
    return sorted([*map(_load, entry_points(group=GROUP)), *ours], key=lambda spec: spec.rank)


def _load(entry_point: EntryPoint) -> DatasetSpec:
    try:
        spec = entry_point.load()
    except Exception as error:  # whatever a module of someone else raises as it is imported
        raise _refused(entry_point, f"can't be loaded ({error!r})") from error
    if not isinstance(spec, DatasetSpec):
        raise _refused(entry_point, f"is {spec!r}, not a DatasetSpec")
    return spec


def _refused(entry_point: EntryPoint, problem: str) -> BadInputError:
    return BadInputError(
        f"the entry point {entry_point.name} = {entry_point.value} of {GROUP} {problem}: mend or uninstall its package"
    )
