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
    | {"cache_dir", "folder", "index_folder", "dirpath", "default_root_dir", "dir", "names"}
)
"""Last parts of the keys that hold paths and names of files; all keys of the group ``paths`` do, too."""
_OVERRIDE = re.compile(r"(\+{0,2})([\w.@/-]+)=(.*)", re.DOTALL)
_OTHER = re.compile(r"null|\?\?\?|(['\"]).*\1|(choice|glob|range|sort|shuffle)\(.*\)", re.DOTALL)


def as_typed(arguments: Sequence[str]) -> list[str]:
    """The arguments with the values of path keys quoted, so that they are taken as typed.

    A leading ``~/`` is the home folder. What stays as it is: ``null``, a value in quotes, and in a multirun the functions of
    sweeps; there commas separate paths, as they do within ``[...]``. Raises BadInputError for an argument that is still not
    ``key=value``, with the quotes that it needs.
    """
    several = any(argument in ("-m", "--multirun") for argument in arguments)
    typed = [_typed(argument, several) for argument in arguments]
    parser = OverridesParser.create()
    for argument in typed:
        key, equals, value = argument.partition("=")
        if argument.startswith("-") or not equals:
            continue
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
    if value.startswith("[") and value.endswith("]"):
        value = f"[{','.join(map(_as_text, value[1:-1].split(',')))}]"
    else:
        value = ",".join(map(_as_text, value.split(",") if several and not _OTHER.fullmatch(value) else [value]))
    return f"{match[1]}{match[2]}={value}"


def holds_path(key: str) -> bool:
    """Whether the value of a key, with dots, is a path."""
    *groups, last = key.split(".")
    return last in PATH_KEYS or groups[-1:] == ["paths"]


def _as_text(value: str) -> str:
    value = value.strip()
    if not value or _OTHER.fullmatch(value):
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
