"""Tests mirror the package: those of ``sips_lit/a/b.py`` are in ``tests/a/test_b.py``."""

from pathlib import Path

import sips_lit

PACKAGE, TESTS = Path(sips_lit.__file__).parent, Path(__file__).parent


def test_every_module_has_tests_of_its_name():
    modules = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"]
    missing = sorted(str(m) for m in modules if not (TESTS / m.parent / f"test_{m.name}").is_file())
    assert len(modules) > 100
    assert not missing, "add tests/<room>/test_<module>.py for each of these"
