"""A seeded part of all wrong values for all keys (benchmarks/README.md)."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "wrong_values.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, SCRIPT, *arguments], capture_output=True, text=True)


@pytest.mark.slow
def test_wrong_values_are_refused_with_a_sentence():
    done = run("--sample", "40", "--seed", "1")
    assert (done.returncode, done.stdout) == (0, "40 runs, 0 failed\n"), done.stdout + done.stderr


def test_what_ends_otherwise_is_noticed(tmp_path):
    """A command that lets an error through, one that says two sentences, and one that says one."""
    script = f"""
import runpy, sys, types
own = runpy.run_path({str(SCRIPT)!r})
def raising(): raise ValueError("a defect")
def two(): print("error: a", "error: b", sep=chr(10), file=sys.stderr); sys.exit(1)
def one(): print("error: a", file=sys.stderr); sys.exit(1)
for name, main in dict(raising=raising, two=two, one=one, good=lambda: None).items():
    sys.modules["sips_lit.cli." + name] = types.SimpleNamespace(main=main)
    print(name, own["end_of"](name, []))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "raising ValueError: a defect",
        "two exit 1: error: a error: b",
        "one None",
        "good None",
    ], done.stderr


def test_keys_are_those_of_single_values():
    script = f"import runpy; print(*runpy.run_path({str(SCRIPT)!r})['keys_of']('index', ['data=folder']), sep='\\n')"
    keys = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout.splitlines()
    assert {"workers", "data.path", "overlap_parameters.spacing", "paths.indexes"} <= set(keys)
    assert not {"data", "overlap_parameters", "hydra"} & {key.partition(".")[0] for key in keys if "." not in key}
