"""The methods of an evaluation: detectors by name with overrides, each with its own descriptor and with the common one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, ListConfig, OmegaConf, open_dict

from sips_lit.cli.app import build
from sips_lit.cli.explain import explain
from sips_lit.errors import BadInputError
from sips_lit.evaluate.method import Method, checkpoint_of, signature_of
from sips_lit.files import safe_name
from sips_lit.types import Descriptor, Detector


@dataclass(frozen=True, slots=True)
class Entry:
    """A detector as asked for: its name in the group ``detector``, and what is set differently.

    With ``_target_`` among the overrides it needs no file in the group, and the name is what files and tables call it.
    ``parts``: how many last parts of a path are told.
    """

    detector: str
    overrides: Mapping[str, Any]
    parts: int = 1

    @property
    def key(self) -> str:
        """Different for entries that differ."""
        return safe_name("_".join([self.detector, *(f"{key}_{value}" for key, value in self._noted)]))

    @property
    def note(self) -> str:
        """What tells it from the same detector as configured; empty if nothing."""
        parts = [f"{key} {value}" for key, value in self._noted]
        return f" ({', '.join(parts)})" if parts else ""

    @property
    def _noted(self) -> list[tuple[str, str]]:
        given = [(key, Path(str(value)).parts) for key, value in self.overrides.items() if key != "_target_"]
        return [(key, str(Path(*parts[-self.parts :]))) for key, parts in given]


def known_detectors() -> list[str]:
    """The names of the group ``detector``: the package's, and those that ``hydra.searchpath`` adds."""
    options = GlobalHydra.instance().config_loader().get_group_options("detector", overrides=_searchpath())
    return sorted(options)


def parse_entries(detectors: Any) -> list[Entry]:
    """``detectors=`` as entries: ``all``, or a list of names and of one-key mappings from a name to its overrides.

    Raises BadInputError for an unknown detector or key, an entry given twice, and anything that is no such list.
    """
    known = known_detectors()
    plain = OmegaConf.to_container(detectors) if isinstance(detectors, ListConfig | DictConfig) else detectors
    listed = known if plain == "all" else [plain] if isinstance(plain, str) else plain
    if not isinstance(listed, list) or not listed:
        raise BadInputError(f"detectors is {plain}: give all, or a list of {', '.join(known)}")
    entries = [_entry(item, known) for item in listed]
    twice = next((entry for entry in entries if entries.count(entry) > 1), None)
    if twice is not None:
        raise BadInputError(f"detectors has {twice.key} twice: leave one out")
    return _told_apart(entries)


def _told_apart(entries: list[Entry]) -> list[Entry]:
    """Different entries with different keys: ``best.ckpt`` of several runs is told with the folders in which they differ."""
    longest = max(len(Path(str(value)).parts) for entry in entries for value in ("", *entry.overrides.values()))
    for parts in range(2, longest + 1):
        keys = [entry.key for entry in entries]
        entries = [
            replace(entry, parts=parts) if keys.count(key) > 1 else entry
            for entry, key in zip(entries, keys, strict=True)
        ]
    return entries


def make_methods(config: DictConfig, on_skip: Callable[[str, str], None]) -> list[Method]:
    """Each of ``detectors`` with its own descriptor, if it has one, and with the common one, if there is one.

    A detector that can't be made (a missing package, weight or checkpoint) is passed to ``on_skip`` with the reason. Raises
    BadInputError as `parse_entries` does.
    """
    entries = [(entry, with_detector(config, entry)) for entry in parse_entries(config.detectors)]
    descriptor: Descriptor | None = build(config.descriptor)
    methods = []
    for entry, whole in entries:
        try:
            detector: Detector = build(whole.detector)
        except Exception as error:  # what is not the user's to mend is raised on
            reason = explain(error, whole)
            if reason is None:
                raise
            on_skip(entry.key, reason)
            continue
        if descriptor is None and not detector.describes:
            on_skip(entry.key, f"{detector.name} does not describe its points: give a common descriptor, as rootsift")
        own = [None] if detector.describes else []
        common = [] if descriptor is None else [descriptor]
        methods += [_method(entry.key, entry.note, detector, one, whole) for one in [*own, *common]]
    return methods


def configured_method(config: DictConfig) -> Method:
    """``detector`` with ``descriptor``. Raises BadInputError when neither describes the points."""
    detector: Detector = build(config.detector)
    return _method(safe_name(detector.name).lower(), "", detector, build(config.descriptor), config)


def _method(key: str, note: str, detector: Detector, descriptor: Descriptor | None, config: DictConfig) -> Method:
    plain, name = OmegaConf.to_container(config.detector, resolve=True), detector.name + note
    assert isinstance(plain, dict)
    checkpoint = checkpoint_of({str(name): value for name, value in plain.items()})
    if descriptor is None:
        return Method(key, name, detector, None, signature_of(detector, None, plain, None), checkpoint)
    signature = signature_of(detector, descriptor, plain, OmegaConf.to_container(config.descriptor, resolve=True))
    key = f"{key}_{safe_name(descriptor.name).lower()}"
    return Method(key, f"{name} + {descriptor.name}", detector, descriptor, signature, checkpoint)


def _entry(item: Any, known: list[str]) -> Entry:
    overrides: Any = {}
    if isinstance(item, dict) and len(item) == 1:
        ((item, overrides),) = item.items()
    if not isinstance(item, str) or not isinstance(overrides or {}, dict):
        raise BadInputError(
            f"detectors has the entry {item}: give a name, or a name with its keys: {{aliked: {{variant: n16}}}}"
        )
    if item not in known and "_target_" not in (overrides or {}):
        raise BadInputError(f"there is no detector {item}: choose from {', '.join(known)}")
    return Entry(item, overrides or {})


def with_detector(config: DictConfig, entry: Entry) -> DictConfig:
    """The whole configuration with an entry as its detector, unresolved, as it may refer to the rest.

    Any argument of the detector's constructor may be set, whether or not its file names it.
    """
    node = OmegaConf.create({})
    if "_target_" not in entry.overrides:
        overrides = [*_searchpath(), f"detector={entry.detector}"]
        loader = GlobalHydra.instance().config_loader()
        node = loader.load_configuration("evaluate", overrides, RunMode.RUN, from_shell=False).detector
        node._set_parent(None)
        known = list(inspect.signature(hydra.utils.get_object(node["_target_"])).parameters)
        unknown = next((key for key in entry.overrides if key not in known), None)
        if unknown is not None:
            has = ", ".join(known) or "none"
            raise BadInputError(f"detectors sets {unknown} of {entry.detector}, which has no such key: it has {has}")
    whole = config.copy()
    with open_dict(whole):
        whole.detector = node
        whole.detector.merge_with(dict(entry.overrides))
    return whole


def _searchpath() -> list[str]:
    """The override that adds the user's packages to Hydra's search path, as this run has it."""
    paths = list(HydraConfig.get().searchpath) if HydraConfig.initialized() else []
    return [f"hydra.searchpath={paths}"] if paths else []
