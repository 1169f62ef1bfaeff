"""The package of a user's own that the how-to pages describe, made from their blocks of code."""

from __future__ import annotations

import re
from pathlib import Path

from markdown_code import ROOT, blocks

PAGES = ("own-detector", "own-descriptor", "own-data-set", "own-label-source", "own-metric")
CONFIGURATION = re.compile(r"`my_package/(conf/\w+/(\w+)\.yaml)`")


def write_documented_package(folder: Path) -> Path:
    """Writes ``my_package`` into ``folder``: of each page the Python and the YAML, under the names that the page tells."""
    package = folder / "my_package"
    (package / "conf").mkdir(parents=True)
    for init in (package / "__init__.py", package / "conf" / "__init__.py"):
        init.touch()
    for name in PAGES:
        page = f"docs/how-to/{name}.md"
        told = CONFIGURATION.search((ROOT / page).read_text(encoding="utf-8"))
        assert told is not None, f"{page} names no file of my_package/conf"
        (code,) = (block.text for block in blocks("python") if block.page == page)
        (configuration,) = (block.text for block in blocks("yaml") if block.page == page)
        (package / f"{told[2]}.py").write_text(code, encoding="utf-8")
        (package / told[1]).parent.mkdir(exist_ok=True)
        (package / told[1]).write_text(configuration, encoding="utf-8")
    return package
