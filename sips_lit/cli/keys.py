"""Keys that a command does not have: a sentence that names the nearest one that it has."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection, Iterator, Sequence
from difflib import SequenceMatcher
from typing import Any, Final

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException, MissingConfigException
from hydra.utils import get_object
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sips_lit.cli.conf_files import CONF_DIR

ALIKE: Final = 0.7  # ratio of difflib from which a name is worth a guess; our choice
OTHER_WORDS: Final = {
    "epochs": "trainer.max_steps",
    "max_epochs": "trainer.max_steps",
    "batch_size": "trainer.accumulate_grad_batches",
    "pairs_per_step": "trainer.accumulate_grad_batches",
    "gpus": "trainer.devices",
    "checkpoint": "init",  # where no key is called so
    "resume": "ckpt_path",
    "input": "data.path",
}
"""What other programs call some keys: nothing in their letters leads to ours."""
IN_STEPS: Final = frozenset({"epochs", "max_epochs"})
"""Keys of other programs whose number is none for ours: a run is counted in steps."""
FREE: Final = frozenset({"callbacks", "pair_sets", "sources"})
"""Mappings whose keys are names that the user gives; what is read of their entries, their readers check."""
_GROUP = re.compile(r"\+?([\w/]+)(?:@[\w.]+)?=(\w+)")
_UNKNOWN = re.compile(
    r"Could not (?:override|delete)(?: from config\.)? '([^'=]+)(?:=[^']*)?'|config group '([^']+)' does not"
)
_TWICE = re.compile(
    r"An item is already at '([^']+)'|(\S+) appears more than once|groups is not supported: '\+*([^=]+)"
)
_NO_LIST = re.compile(r"Error merging override ([^=\s]+)=(.*)\nCannot merge DictConfig with ListConfig")
_SEVERAL = re.compile(r"Ambiguous value for argument '([^=]+)=(.*)'")


def explain_composition(error: Exception, command: str, arguments: Sequence[str]) -> str | None:
    """One sentence for a key or a choice that the configuration of a command does not have; None for other errors.

    ``arguments`` are those of the command line, of which the choices of groups decide what keys there are.
    """
    text = str(error)
    if isinstance(error, MissingConfigException) and error.options:
        group, _, name = str(error.missing_cfg_file).rpartition("/")
        guess = _guess(nearest(name, error.options)).replace("? ", "? Else ")
        return f"there is no {group}={name}: {guess}choose among {', '.join(error.options)}"
    found = _UNKNOWN.search(text)
    if found:
        return unknown_key(found[1] or found[2], command, plain_config(command, arguments), composed=False)
    found = _TWICE.search(text)
    if found:
        key = next(part for part in found.groups() if part)
        return f"{key} is a key of sips-{command} already: write {key}=... without the +"
    found = _NO_LIST.search(f"{text}\n{error.__cause__}")
    if found:
        key, value = found.groups()
        return f"{key} is {value}: give a list in square brackets, [1,2]"
    found = _SEVERAL.search(text)
    if found:
        key, values = found.groups()
        return f"{key}={values} has several values: add -m to run each of them, or write {key}=[{values}] for a list"
    return None


def unknown_key(key: str, command: str, config: dict[str, Any], composed: bool = True) -> str:
    """The sentence about a key that nobody reads, with what it may have been meant for.

    ``config`` is the plain configuration of the command; of a part of it that a constructor makes, the arguments of that
    count, too. ``composed``: the key got into it, by a plus or a file; else a plus may be what it needs.
    """
    parent, _, last = key.rpartition(".")
    known = set(dotted(config)) if key.startswith("hydra.") else own_keys(config)
    if last in IN_STEPS and OTHER_WORDS[last] in known:
        return f"nothing in sips-{command} reads the key {key}: {in_steps(OTHER_WORDS[last])}=..."
    node = _at(config, parent)
    target = node.get("_target_") if isinstance(node, dict) else None
    takes = (arguments_of(target) if isinstance(target, str) else None) or ()
    if last in takes:
        return f"the configuration has no {key}, but {str(target).rpartition('.')[2]} takes it: write +{key}=..."
    if "@" in key:
        known = {choice for choice in config["hydra"]["runtime"]["choices"] if "@" in choice}
    names = {*_beside(key, known), *(f"{parent}.{name}" for name in takes)}
    guess = _guess(nearest(key, names))
    if not composed and _free_part(key) is not None:
        return f"the configuration has no {key}: {guess.replace('? ', '? Else ')}write +{key}=... to add it"
    told = guess or f"sips-{command} --cfg job shows those that there are"
    return f"nothing in sips-{command} reads the key {key}: {told}".rstrip(" ;")


def in_steps(key: str) -> str:
    """That a number of epochs is none for ``key``."""
    return f"a run is counted in steps, not in epochs (--help has the number): set {key}"


def _free_part(key: str) -> str | None:
    """The mapping of names of the user's own that a key is in, as ``data.sources``; None where there is none."""
    parts = key.split(".")
    return next((".".join(parts[: at + 1]) for at, part in enumerate(parts[:-1]) if part in FREE), None)


def _beside(key: str, known: Collection[str]) -> Collection[str]:
    """The keys that one may have been meant for: within a mapping of the user's own names those within it."""
    free = _free_part(key)
    return known if free is None else [name for name in known if name.startswith(f"{free}.")]


def nearest(key: str, names: Collection[str]) -> str | None:
    """The most alike of some names, which may have dots, or None: the whole counts, and nearly as much the last part."""
    word = OTHER_WORDS.get(key.rpartition(".")[2])
    if word in names:
        return word

    def likeness(name: str) -> float:
        ends = SequenceMatcher(None, key.rpartition(".")[2], name.rpartition(".")[2]).ratio()
        return max(SequenceMatcher(None, key, name).ratio(), 0.95 * ends)

    best = min(names, key=lambda name: (-likeness(name), name.count("."), name), default=None)
    return best if best is not None and likeness(best) >= ALIKE else None


def arguments_of(target: str) -> set[str] | None:
    """The arguments of a class or function; None where it takes any, or can't be found, which Hydra tells better."""
    try:
        parameters = inspect.signature(get_object(target)).parameters
    except (ValueError, ImportError, TypeError):
        return None
    return None if any(p.kind is p.VAR_KEYWORD for p in parameters.values()) else set(parameters)


def plain_config(command: str, arguments: Sequence[str] = ()) -> dict[str, Any]:
    """The configuration of a command with the choices of groups among the arguments, as plain values, uninterpolated."""
    chosen = [argument for argument in arguments if _is_choice(argument)]
    paths = [argument for argument in arguments if argument.startswith("hydra.searchpath=")]
    GlobalHydra.instance().clear()
    for overrides in ([*paths, *chosen], []):
        try:
            with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
                plain: Any = OmegaConf.to_container(compose(command, overrides, return_hydra_config=True))
                return dict(plain)
        except (HydraException, OmegaConfBaseException):  # choices that do not fit each other: the defaults tell enough
            continue
    return {}


def _is_choice(argument: str) -> bool:
    match = _GROUP.fullmatch(argument)
    return match is not None and (CONF_DIR / match[1] / f"{match[2]}.yaml").is_file()


def dotted(node: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """The keys of nested mappings, with dots."""
    for name, value in node.items():
        if not str(name).startswith("_"):
            yield f"{prefix}{name}"
        if isinstance(value, dict):
            yield from dotted(value, f"{prefix}{name}.")


def own_keys(config: dict[str, Any]) -> set[str]:
    """All keys but Hydra's, with dots."""
    return {name for name in dotted(config) if name.partition(".")[0] != "hydra"}


def _at(config: Any, key: str) -> Any:
    for part in key.split(".") if key else ():
        config = config.get(part) if isinstance(config, dict) else None
    return config


def _guess(name: str | None) -> str:
    return "" if name is None else f"did you mean {name}? "
