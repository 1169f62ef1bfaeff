"""What the program tells to write exists: the keys of its messages are keys of a command."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from omegaconf import OmegaConf

import sips_lit
from sips_lit.cli.conf_files import CONF_DIR, options_of
from sips_lit.cli.keys import dotted, plain_config

PACKAGE = Path(sips_lit.__file__).parent
KEY = re.compile(r"(?<![\w.{}@$/'\"-])\+?((?:[a-z_]\w*\.)*[a-z_]\w*(?:@[a-z_.]+)?)=(?![=\s)])([\w-]*)")
NO_KEYS = {"key", "group", "a", "bytes"}  # of an explanation of key=value, of HTTP
NOT_FOR_USERS = {"report/embedding.py"}  # SVG


def messages(tree: ast.Module) -> Iterator[str]:
    """The text constants of a module but its docstrings, with … for what is put in."""
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in node.values}
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            yield node.value


def hints() -> list[tuple[str, str, str]]:
    found = set()
    for path in PACKAGE.rglob("*.py"):
        name = str(path.relative_to(PACKAGE))
        if name not in NOT_FOR_USERS:
            text = "\n".join(messages(ast.parse(path.read_text(encoding="utf-8"))))
            found |= {(name, *hint) for hint in KEY.findall(text) if hint[0] not in NO_KEYS}
    return sorted(found)


@pytest.fixture(scope="module")
def keys() -> set[str]:
    known = {
        "data@val_data",
        "hydra.mode",
        "hydra.searchpath",
        *(path.name for path in CONF_DIR.iterdir() if path.is_dir()),
    }
    for path in CONF_DIR.glob("*.yaml"):
        known |= set(dotted(plain_config(path.stem)))
    for path in CONF_DIR.glob("*/*.yaml"):
        known |= {f"{path.parent.name}.{key}" for key in OmegaConf.load(path)}
        known |= {f"val_data.{key}" for key in OmegaConf.load(path) if path.parent.name == "data"}
    return known


def test_every_hint_names_a_key(keys):
    named = hints()
    assert len(named) > 40
    assert [hint for hint in named if hint[1] not in keys] == []


def test_every_hint_to_a_group_names_a_choice_of_it():
    of_groups = [hint for hint in hints() if options_of(hint[1].partition("@")[0]) and hint[2]]
    assert len(of_groups) > 5
    assert [hint for hint in of_groups if hint[2] not in options_of(hint[1].partition("@")[0])] == []
