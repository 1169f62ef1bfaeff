import runpy
import subprocess
import sys

from cli_runs import ROOT

read_tables = runpy.run_path(str(ROOT / "benchmarks" / "mutants.py"))["read_tables"]


def test_every_mutant_fits_the_package_as_it_is():
    mutants = read_tables()
    assert len(mutants) > 900
    package = ROOT / "sips_lit"
    broken = [str(each) for each in mutants if (package / each.file).read_text("utf-8").count(each.old) != 1]
    assert not broken
    assert all(each.old != each.new for each in mutants)


def test_every_mutant_has_tests_that_are_there():
    tests = {test for each in read_tables() for test in each.tests}
    assert not [test for test in sorted(tests) if not (ROOT / "tests" / test).exists()]


def test_one_is_killed_by_tests_that_pass_without_it(monkeypatch):
    """Its tests run without plugins of pytest: fixtures or options that need one would fail them all."""
    monkeypatch.setenv("PYTEST_ADDOPTS", "--cov")  # as CI has it
    monkeypatch.setenv("PYTEST_PLUGINS", "pytest_cov")
    command = [sys.executable, "benchmarks/mutants.py", "--only", "detect/turns.py: the last turn counts"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert "1 killed, 0 survived, 0 broken of 1 mutants" in ended.stdout, ended.stdout + ended.stderr
