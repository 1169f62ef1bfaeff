"""Options as other programs have them: what was meant is written key=value."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from typing import Final

from sips_lit.cli.keys import IN_STEPS, in_steps, nearest
from sips_lit.errors import BadInputError

FLAGS: Final = frozenset({"--help", "-h", "--hydra-help", "--version", "--resolve", "--run", "-r", "--multirun", "-m"})
TAKING: Final = frozenset(
    {"--cfg", "-c", "--package", "-p", "--config-path", "-cp", "--config-name", "-cn", "--config-dir", "-cd"}
    | {"--experimental-rerun", "--info", "-i", "--shell-completion", "-sc"}
)
"""Options of Hydra that something follows, in the same word or the next."""
SWEEP: Final = frozenset({"-m", "--multirun"})


def refuse_options(arguments: Sequence[str], keys: Callable[[], Collection[str]]) -> None:
    """Raises BadInputError for an option that there is not, with the key that it may be. ``keys`` makes those there are."""
    for at, argument in enumerate(arguments):
        option, equals, value = argument.partition("=")
        if not re.fullmatch(r"--?[A-Za-z][\w.-]*", option) or option in FLAGS | TAKING:
            continue
        if at and arguments[at - 1] in TAKING:
            continue
        following = arguments[at + 1 : at + 2]
        if not equals and following and "=" not in following[0] and not following[0].startswith("-"):
            value = following[0]
        meant = option.lstrip("-").replace("-", "_")
        names = keys()
        key = meant if meant in names else nearest(meant, names)
        if key is not None and meant in IN_STEPS:
            raise BadInputError(f"there is no option {option}: {in_steps(key)}=..., without dashes")
        told = f"here {key}={value or '...'}" if key is not None else "see --help"
        raise BadInputError(f"there is no option {option}: a key is written key=value, without dashes, {told}")


def sweep_first(arguments: Sequence[str]) -> list[str]:
    """The arguments with ``-m`` before them: between others Hydra's parser takes it for the end of the list."""
    return [a for a in arguments if a in SWEEP] + [a for a in arguments if a not in SWEEP]
