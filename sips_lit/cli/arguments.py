"""Arguments as a shell gives them: a path is text, whatever the grammar of the configuration language makes of it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from sips_lit.errors import BadInputError
from sips_lit.files import LONGEST_NAME, can_be_path

PATH_KEYS: Final = frozenset(
    {"path", "root", "input", "output", "checkpoint", "ckpt_path", "pairs_file", "features", "images", "weights"}
    | {"init", "teacher"}
    | {"results", "cache_dir", "folder", "index_folder", "dirpath", "default_root_dir", "dir", "names", "filename"}
    | {"gradient_costs"}
    | {"camera"}
)
"""Last parts of the keys that hold paths and names of files; all keys of the group ``paths`` do, too."""
_KEY = r"(\+{0,2})([\w.@/-]+)"
_OVERRIDE = re.compile(rf"{_KEY}=(.*)", re.DOTALL)
_STAYS = re.compile(r"null|\?\?\?|(['\"]).*\1", re.DOTALL)
_SWEEP = re.compile(r"(choice|glob|range|sort|shuffle)\(.*\)", re.DOTALL)
POSITIONAL: Final = {"report": "results", "match": "input"}
"""Keys that take the plain arguments of a command, as a list."""
_MULTIRUN = frozenset({"-m", "--multirun", "hydra.mode=MULTIRUN"})
# up to a comma that is not in quotes or, of a list within a multirun, in brackets
_ITEM = re.compile(r"""\s*((?:(['"])(?:\\.|(?!\2).)*\2|\[[^][]*\])(?=\s*(?:,|$))|[^,]*?)\s*(?:,|$)""", re.DOTALL)


def with_keys(command: str, arguments: Sequence[str]) -> list[str]:
    """The arguments with the plain ones, which are files and no ``key=value``, as the list of the command's key for them.

    ``sips-report a.json b.json`` is ``sips-report results=['a.json','b.json']``. What is there is one whatever its name.
    Raises BadInputError for plain ones beside the key.
    """
    key = POSITIONAL.get(command)
    if key is None:
        return list(arguments)
    plain: list[str] = []
    others: list[str] = []
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option = argument.startswith(("-", "~")) or (before.startswith("-") and before not in _MULTIRUN)
        is_file = not option and (not _OVERRIDE.fullmatch(argument) or Path(argument).exists())
        (plain if is_file else others).append(argument)
    if plain and any(argument.startswith(f"{key}=") for argument in others):
        raise BadInputError(f"there are both {plain[0]} and {key}=: give the files in one of these ways")
    return [*others, *([f"{key}=[{','.join(map(_as_text, plain))}]"] if plain else [])]


def as_typed(arguments: Sequence[str]) -> list[str]:
    """The arguments with the values of path keys quoted, so that they are taken as typed.

    A leading ``~/`` is the home folder. What stays as it is: ``null``, a value in quotes, and in a multirun the functions of
    sweeps; there commas separate paths, as they do within ``[...]``. Raises BadInputError for an argument that is still not
    ``key=value``, with the quotes that it needs.
    """
    several = not _MULTIRUN.isdisjoint(arguments)
    typed = [_typed(argument, several) for argument in arguments]
    parser = OverridesParser.create()
    for before, argument in zip(["", *typed], typed, strict=False):
        if argument.startswith(("-", "~")) or (before.startswith("-") and before not in _MULTIRUN):
            continue  # options and what they take
        key, equals, value = (part.strip() for part in argument.partition("="))
        if not equals or not re.fullmatch(_KEY, key):
            raise BadInputError(
                f"the argument {argument} is no key=value, such as data.path=... or input=...: write both in one word, and "
                "in quotes for the shell where there are spaces in it"
            )
        try:
            parser.parse_override(argument)
        except HydraException as error:
            raise BadInputError(
                f"the argument {argument} can't be read as key=value: put the value in quotes, and all of it for the shell: "
                f"{_for_shell(f'{key}={quoted(value)}')}"
            ) from error
    return typed


def _typed(argument: str, several: bool) -> str:
    match = _OVERRIDE.fullmatch(argument)
    if match is None or not holds_path(match[2]):
        return argument
    value = match[3]
    if not several or match[2].startswith("hydra."):  # Hydra's own keys can't be swept
        value = _as_text(value)
    elif not _SWEEP.fullmatch(value):
        value = ",".join(map(_as_text, _items(value)))
    return f"{match[1]}{match[2]}={value}"


def _items(value: str) -> list[str]:
    return [item[1] for item in _ITEM.finditer(value) if item[1] or item.end() < len(value)]


def holds_path(key: str) -> bool:
    """Whether the value of a key, with dots, is a path."""
    *groups, last = key.split(".")
    return last in PATH_KEYS or groups[-1:] == ["paths"]


def _as_text(value: str) -> str:
    """A path, or a list of paths, in quotes."""
    if value.startswith("[") and value.endswith("]") and not re.match(r"\[[^][]*\].", value):  # such as [1] take [2]
        return f"[{','.join(map(_as_text, _items(value[1:-1])))}]"
    if not value or _STAYS.fullmatch(value):
        return value
    if not can_be_path(value):
        raise BadInputError(f"{value} can't be a path: the name of a file or folder has at most {LONGEST_NAME} bytes")
    return quoted(str(Path(value).expanduser()) if value == "~" or value.startswith("~/") else value)


def path_argument(key: str, path: Path) -> str:
    """``key=path`` for a hint: plain where commands take that as typed, in quotes where a name looks like grammar."""
    plain = f"{key}={path}"
    (argument,) = as_typed([plain])
    return plain if argument.endswith(f"={quoted(str(path))}") else f"{key}={quoted(str(path))}"


def quoted(value: str) -> str:
    """The value in quotes of the configuration language, in which a quote and backslashes before one are escaped."""
    escaped = re.sub(r"(\\*)'", r"\1\1\'", value)
    return "'" + re.sub(r"(\\+)$", r"\1\1", escaped) + "'"


def _for_shell(argument: str) -> str:
    return shlex.quote(argument) if re.search(r'["$`\\!]', argument) else f'"{argument}"'
