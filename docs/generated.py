"""Pages of the site that are made from the program: its commands, its configuration, its public names.

A hook of MkDocs, so that no list is copied by hand. Nothing here imports more of `sips_lit` than its list of names.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[1]
PACKAGE, CONF = ROOT / "sips_lit", ROOT / "conf"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages under reference/, and the colours of code."""
    from mkdocs.structure.files import File  # here, so that the tests read the pages without MkDocs
    from pygments.formatters import HtmlFormatter

    pages = {"commands": commands_page(), "configuration": configuration_page(), "api": api_page()}
    for name, text in pages.items():
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    files.append(File.generated(config, "code.css", content=HtmlFormatter().get_style_defs(".highlight")))
    return files


def commands_page() -> str:
    """Each command of pyproject.toml: what its module says, and where its keys are."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        scripts: dict[str, str] = tomllib.load(file)["project"]["scripts"]
    parts = [
        "# Commands",
        "Each takes every key of its [configuration](configuration.md) on the command line (`key=value`), refuses unknown "
        "keys, prints what it wrote and where, and exits with 0 on success, 1 on bad input (one sentence says which file or "
        "key, what is wrong and what to do), 130 after Ctrl-C, 143 after "
        "SIGTERM. The text below is what `--help` prints.",
    ]
    for command in scripts:
        name = command.removeprefix("sips-")
        module = f"sips_lit.cli.{name}"
        summary = docstring(ROOT / f"{module.replace('.', '/')}.py").removeprefix(f"{command}: ")
        parts += [f"## {command}", summary[0].upper() + summary[1:]]
        if (CONF / f"{name}.yaml").is_file():
            parts.append(f"```text\n{help_of(name)}\n```")
            parts.append(f"All keys: [`conf/{name}.yaml`](configuration.md#{name}).")
        else:
            parts += [f"```text\n{text}\n```" for text in help_texts(module)]
    return "\n\n".join(parts)


def help_of(name: str) -> str:
    """What a command prints with ``--help``, without the folder of the machine that makes the page."""
    sys.path.insert(0, str(ROOT))
    from sips_lit.cli.help import WIDTH, help_text

    return help_text(name, WIDTH).replace(str(CONF), "conf/")


def help_texts(module: str) -> list[str]:
    """What a command without a configuration says of itself and of its subcommands."""
    code = (
        f"from {module} import parser; top = parser(); print(top.format_help());"
        "[print('\\0' + sub.format_help()) for action in top._actions for sub in (action.choices or {}).values()]"
    )
    environment = {**os.environ, "COLUMNS": "100", "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return [text.strip() for text in run.stdout.split("\0")]


def configuration_page() -> str:
    """Every file of conf/ as it is: its comments are the documentation of its keys."""
    parts = [
        "# Configuration",
        "The files of `conf/` as they are: a command's own first, then the groups from which `group=name` chooses a file. "
        "`???` has to be given, `null` is nothing, `${...}` refers to another key. A key is an argument of the constructor "
        "that `_target_` names, which has the full description.",
        "## Commands",
    ]
    for path in sorted(CONF.glob("*.yaml")):
        parts += [f"### sips-{path.stem} {{ #{path.stem} }}", yaml_block(path)]
    for group in sorted({path.parent for path in CONF.rglob("*.yaml")} - {CONF}):
        choice = group.relative_to(CONF).as_posix()
        parts.append(f"## {choice} {{ #group-{group.name} }}")
        for path in sorted(group.glob("*.yaml")):
            parts += [f"### {choice}={path.stem} {{ #{group.name}-{path.stem} }}", yaml_block(path)]
    return "\n\n".join(parts)


def yaml_block(path: Path) -> str:
    """A file as a block of code."""
    return f"```yaml\n{path.read_text(encoding='utf-8').strip()}\n```"


def api_page() -> str:
    """The public names by room, from their docstrings."""
    sys.path.insert(0, str(ROOT))
    from sips_lit import PUBLIC

    parts = [
        "# Python",
        "Import everything here from `sips_lit` itself, as in `from sips_lit import SipsDetector`; it is loaded when it is "
        "first used. Annotations are part of the package (`py.typed`).",
    ]
    rooms: dict[str, list[str]] = {}
    for module, names in PUBLIC.items():
        rooms.setdefault(module.partition(".")[0], []).extend(f"sips_lit.{module}.{name}" for name in names)
    for room, names in rooms.items():
        file = PACKAGE / f"{room}.py" if (PACKAGE / f"{room}.py").is_file() else PACKAGE / room / "__init__.py"
        parts += [f"## {room}", docstring(file).partition("\n\n")[0]]
        parts += [f"::: {name}" for name in names]
    return "\n\n".join(parts)


def docstring(path: Path) -> str:
    """What a module says of itself."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
