"""Tests mirror the package: those of ``sips_lit/a/b.py`` are in ``tests/a/test_b.py``."""

from pathlib import Path

import sips_lit

PACKAGE, TESTS = Path(sips_lit.__file__).parent, Path(__file__).parent

# Modules whose tests are still being written: take a line away with the test file that comes.
WITHOUT_TESTS = {
    "errors.py",
    "evaluate/result.py",
}


def modules() -> list[Path]:
    return sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")


def test_every_module_has_tests_of_its_name():
    missing = [str(m) for m in modules() if not (TESTS / m.parent / f"test_{m.name}").is_file()]
    assert len(modules()) > 150
    assert set(missing) <= WITHOUT_TESTS, "add tests/<room>/test_<module>.py for each of these"


def test_no_exception_outlives_its_reason():
    """A module that has its tests, or is gone, leaves the list."""
    needless = [name for name in WITHOUT_TESTS if (TESTS / Path(name).parent / f"test_{Path(name).name}").is_file()]
    gone = WITHOUT_TESTS - {str(module) for module in modules()}
    assert not needless
    assert not gone
