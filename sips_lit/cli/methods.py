"""The detectors of a benchmark, by name with overrides: each with its own descriptor and with the common one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig, ListConfig, OmegaConf, open_dict

from sips_lit.cli.app import CONF_DIR, build, explain
from sips_lit.errors import BadInputError
from sips_lit.evaluate.method import Method, signature_of
from sips_lit.files import safe_name
from sips_lit.types import Descriptor, Detector


@dataclass(frozen=True, slots=True)
class Entry:
    """A detector as asked for: its name in conf/detector, what is set differently, and what it is called in files."""

    detector: str
    overrides: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Different for entries that differ."""
        parts = [f"{key}_{Path(str(value)).name}" for key, value in self.overrides.items()]
        return safe_name("_".join([self.detector, *parts]))

    @property
    def note(self) -> str:
        """What tells it from the same detector as configured; empty if nothing."""
        parts = [f"{key} {Path(str(value)).name}" for key, value in self.overrides.items()]
        return f" ({', '.join(parts)})" if parts else ""


def known_detectors() -> list[str]:
    """The names of conf/detector."""
    return sorted(path.stem for path in (CONF_DIR / "detector").glob("*.yaml"))


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
    keys = [entry.key for entry in entries]
    twice = next((key for key in keys if keys.count(key) > 1), None)
    if twice is not None:
        raise BadInputError(f"detectors has {twice} twice: leave one out")
    for entry in entries:
        _detector_node(entry)
    return entries


def make_methods(config: DictConfig, entries: list[Entry], on_skip: Callable[[str, str], None]) -> list[Method]:
    """Each detector with its own descriptor, if it has one, and with the common one, if there is one.

    A detector that can't be made (a missing package, weight or checkpoint) is told to ``on_skip`` with the reason.
    """
    descriptor: Descriptor | None = build(config.descriptor)
    plain_descriptor = OmegaConf.to_container(config.descriptor, resolve=True)
    methods = []
    for entry in entries:
        whole = _with_detector(config, entry)
        try:
            detector: Detector = build(whole.detector)
        except Exception as error:
            reason = explain(error, whole)
            if reason is None:
                raise
            on_skip(entry.key, reason)
            continue
        if descriptor is None and not detector.describes:
            on_skip(entry.key, f"{detector.name} does not describe its points: give a common descriptor, as rootsift")
        plain = OmegaConf.to_container(whole.detector, resolve=True)
        name = detector.name + entry.note
        if detector.describes:
            signature = signature_of(detector, None, plain, None)
            methods.append(Method(entry.key, name, detector, None, signature))
        if descriptor is not None:
            signature = signature_of(detector, descriptor, plain, plain_descriptor)
            key = f"{entry.key}_{safe_name(descriptor.name).lower()}"
            methods.append(Method(key, f"{name} + {descriptor.name}", detector, descriptor, signature))
    return methods


def _entry(item: Any, known: list[str]) -> Entry:
    overrides: Any = {}
    if isinstance(item, dict) and len(item) == 1:
        ((item, overrides),) = item.items()
    if not isinstance(item, str) or not isinstance(overrides or {}, dict):
        raise BadInputError(
            f"detectors has the entry {item}: give a name, or a name with its keys: {{aliked: {{variant: n16}}}}"
        )
    if item not in known:
        raise BadInputError(f"there is no detector {item}: choose from {', '.join(known)}")
    return Entry(item, overrides or {})


def _detector_node(entry: Entry) -> DictConfig:
    """The configuration of the detector with its overrides, unresolved.

    Any argument of its constructor may be set, whether or not the file names it.
    """
    node = OmegaConf.load(CONF_DIR / "detector" / f"{entry.detector}.yaml")
    assert isinstance(node, DictConfig)
    known = list(inspect.signature(hydra.utils.get_object(node["_target_"])).parameters)
    unknown = next((key for key in entry.overrides if key not in known), None)
    if unknown is not None:
        has = ", ".join(known) or "none"
        raise BadInputError(f"detectors sets {unknown} of {entry.detector}, which has no such key: it has {has}")
    merged = OmegaConf.merge(node, dict(entry.overrides))
    assert isinstance(merged, DictConfig)
    return merged


def _with_detector(config: DictConfig, entry: Entry) -> DictConfig:
    """The benchmark's configuration with that of the detector in it, which may refer to it."""
    whole = config.copy()
    with open_dict(whole):
        whole.detector = _detector_node(entry)
    return whole
