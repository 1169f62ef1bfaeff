"""The files of ``conf/``: where they are, and what their comments say of a command and of its keys, read without Hydra."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).resolve().parents[1]
CONF_DIR: Final = PACKAGE / "conf" if (PACKAGE / "conf").is_dir() else PACKAGE.parent / "conf"  # in a wheel, in a clone

_LINE = re.compile(r"(?P<indent> *)(?P<item>- )?(?P<key>[\w@/]+):(?: +(?P<value>.*?))?(?: +# (?P<comment>.*))?")
_MORE = re.compile(r" *# (.*)")


@dataclass(slots=True)
class Described:
    """A key of a file: its default as it is written there, and what the comment beside it says."""

    value: str
    comment: str


@dataclass(frozen=True, slots=True)
class Head:
    """The comment on top of a command's file: what it is for, examples, and the keys that its help shows."""

    purpose: tuple[str, ...]
    examples: tuple[str, ...]
    keys: tuple[str, ...]


def head(command: str) -> Head:
    """What ``conf/<command>.yaml`` begins with: lines of purpose, examples two spaces further in, ``keys: a b c``.

    What follows the keys is for readers of the file only.
    """
    lines = (CONF_DIR / f"{command}.yaml").read_text(encoding="utf-8").splitlines()
    top = [line[1:] for line in itertools.takewhile(lambda line: line.startswith("#"), lines)]
    keys = [line.removeprefix(" keys:") for line in top if line.startswith(" keys:")]
    told = list(itertools.takewhile(lambda line: not line.startswith(" keys:"), top))
    examples = [line.strip() for line in told if line.startswith("   ")]
    purpose = [line.strip() for line in told if not line.startswith("   ")]
    return Head(tuple(purpose), tuple(examples), tuple(" ".join(keys).split()))


def described_keys(path: Path) -> dict[str, Described]:
    """The keys of a file, with dots for nesting; the groups of its defaults list are ``defaults.<group>``."""
    found: dict[str, Described] = {}
    parents: list[tuple[int, str]] = []
    last: Described | None = None
    for line in path.read_text(encoding="utf-8").splitlines():
        more, match = _MORE.fullmatch(line), _LINE.fullmatch(line)
        if more and last is not None and last.comment and line.startswith("  "):
            last.comment += f" {more[1]}"  # a comment goes on in the next line
        if match is None:
            last = last if more else None
            continue
        indent = len(match["indent"]) + (1 if match["item"] else 0)
        parents = [parent for parent in parents if parent[0] < indent]
        name = ".".join([*(key for _, key in parents), match["key"]])
        parents.append((indent, match["key"]))
        last = found[name] = Described(match["value"] or "", match["comment"] or "")
    return found


def describe_key(command: str, key: str) -> Described:
    """A key of a command: from its own file, a file that its defaults pull in, or the default choice of its group.

    Raises KeyError where none of these files has it.
    """
    own = described_keys(CONF_DIR / f"{command}.yaml")
    if key in own:
        return own[key]
    if f"defaults.{key}" in own:
        return own[f"defaults.{key}"]
    for name, entry in own.items():
        if name.startswith("defaults.") and name.endswith("@_here_"):
            group = name.removeprefix("defaults.").removesuffix("@_here_")
            pulled = described_keys(CONF_DIR / group / f"{entry.value}.yaml")
            if key in pulled:
                return pulled[key]
    group, _, rest = key.partition(".")
    return described_keys(CONF_DIR / group / f"{own[f'defaults.{group}'].value}.yaml")[rest]


def options_of(group: str) -> list[str]:
    """The names from which ``group=name`` chooses, of those that come with the package."""
    return sorted(path.stem for path in (CONF_DIR / group).glob("*.yaml"))
