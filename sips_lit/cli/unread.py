"""Keys of a composed configuration that nothing reads: what ``+key=value`` or a file of the user's own may add."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Final

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from sips_lit.cli.conf_files import CONF_DIR, described_keys
from sips_lit.cli.keys import FREE, arguments_of, unknown_key
from sips_lit.errors import BadInputError

COMPARED: Final = {"compare": "benchmark"}
"""A key that holds the keys of another command."""
OF_HYDRA: Final = frozenset({"_target_", "_partial_", "_args_", "_convert_", "_recursive_"})
_REFERENCE = re.compile(r"\$\{\.*([\w.]+)")


def refuse_unread(config: DictConfig, command: str) -> None:
    """Raises BadInputError for the first key that nothing reads.

    A key is read when the files of the command have it, when the constructor that its ``_target_`` names takes it, or when
    an interpolation leads to it.
    """
    plain: Any = OmegaConf.to_container(config)
    unread = [key for key in _strangers(plain, known_keys(command), "") if not _is_referred_to(key, plain)]
    if unread:
        raise BadInputError(unknown_key(unread[0], command, _without(plain, unread)))


@cache
def known_keys(command: str) -> Mapping[str, frozenset[str]]:
    """The keys that the files of a command have, by the key above them: "" for those of the command itself."""
    known: dict[str, set[str]] = {"": set()}
    for key, entry in described_keys(CONF_DIR / f"{command}.yaml").items():
        name = key.removeprefix("defaults.")
        group, _, package = name.partition("@")
        if name == key:
            _add(known, "", [key] if key not in ("defaults", "hydra") and not key.startswith("hydra.") else [])
        elif package == "_here_":
            _add(known, "", described_keys(CONF_DIR / group / f"{entry.value}.yaml"))
        else:
            known[""].add(package or name)
            if (CONF_DIR / group / f"{entry.value}.yaml").is_file():
                _add(known, package or name, described_keys(CONF_DIR / group / f"{entry.value}.yaml"))
    return {parent: frozenset(names) for parent, names in known.items()}


def _add(known: dict[str, set[str]], prefix: str, keys: Any) -> None:
    for key in keys:
        parent, _, last = f"{prefix}.{key}".strip(".").rpartition(".")
        known.setdefault(parent, set()).add(last)


def _strangers(node: dict[str, Any], known: Mapping[str, frozenset[str]], path: str) -> Iterator[str]:
    """Keys of a mapping, and of those within it, that neither a file nor a constructor has."""
    target = node.get("_target_")
    taken = arguments_of(target) if isinstance(target, str) else known.get(path)
    free = path.rpartition(".")[2] in FREE
    for name, value in node.items():
        key = f"{path}.{name}" if path else str(name)
        if taken is not None and name not in taken and name not in OF_HYDRA and not free:
            yield key
        elif isinstance(value, dict):
            inner = known_keys(COMPARED[key]) if key in COMPARED else None
            yield from _strangers(value, known, key) if inner is None else _within(value, inner, key)


def _within(node: dict[str, Any], known: Mapping[str, frozenset[str]], path: str) -> Iterator[str]:
    yield from (f"{path}.{key}" for key in _strangers(node, known, ""))


def _is_referred_to(key: str, plain: Any) -> bool:
    """Whether an interpolation of the configuration, or of Hydra's own, leads to a key or into it."""
    hydras: Any = OmegaConf.to_container(HydraConfig.instance().cfg) if HydraConfig.initialized() else {}
    names = {name for text in _texts([plain, hydras]) for name in _REFERENCE.findall(text)}
    return any(f"{name}.".startswith(f"{key}.") for name in names)


def _texts(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    for item in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _texts(item)


def _without(node: Any, keys: list[str], path: str = "") -> Any:
    """The mapping without some of its keys, so that none of them is taken for one that is meant."""
    if not isinstance(node, dict):
        return node
    inner = {name: f"{path}.{name}" if path else str(name) for name in node}
    return {name: _without(value, keys, inner[name]) for name, value in node.items() if inner[name] not in keys}
