import runpy

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
