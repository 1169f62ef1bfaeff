"""A seeded part of the run of 10,000 damaged files (benchmarks/README.md)."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "mutate_files.py"
ENDS = {
    "refuses": "-",
    "fails": "1 FAILED",
    "crashes": "1 CRASHED",
    "fills": "1 OVER MEMORY",
    "hangs": "1 HUNG",
}


def test_damaged_files_are_read_or_refused_with_a_sentence():
    run = subprocess.run([sys.executable, SCRIPT, "--files", "260", "--seed", "3"], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    kind, files, read, refused, *_, failed = run.stdout.splitlines()[-1].split()
    assert (kind, files, failed) == ("all", "260", "-")
    assert int(read) > 50
    assert int(refused) > 50


def test_what_fails_is_noticed(tmp_path):
    """The undamaged files are read, so a reader that is made to fail is told from them by the damage."""
    support = tmp_path / "tests" / "support"
    support.mkdir(parents=True)
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "mutate_files.py").write_text(SCRIPT.read_text())
    (support / "every_file.py").write_text(
        """
import os, time
from types import SimpleNamespace
from sips_lit.errors import BadInputError

def kind(name, damaged):
    def read(folder, file):
        if file.read_bytes() != b"whole" * 20:
            damaged(file)
    return SimpleNamespace(name=name, make=lambda folder: (folder / "a").write_bytes(b"whole" * 20), files="a", read=read)

def refuse(file):
    raise BadInputError(f"{file} is damaged")

KINDS = [kind("refuses", refuse), kind("fails", lambda file: 1 / 0), kind("crashes", lambda file: os.abort()),
         kind("fills", lambda file: b"x" * 10**9), kind("hangs", lambda file: time.sleep(60))]
"""
    )
    script = tmp_path / "benchmarks" / "mutate_files.py"
    script.write_text(script.read_text().replace("SECONDS = 10.0", "SECONDS = 5.0"))
    command = [sys.executable, script, "--files", "5", "--keep", tmp_path / "kept"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 1
    rows = [line.split("  ") for line in run.stdout.splitlines() if line.startswith(tuple(ENDS))]
    assert {row[0].split()[0]: row[-1] for row in rows} == ENDS
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == [
        f"{name}-0-a" for name in ("crashes", "fails", "fills", "hangs")
    ]


def test_mutations_are_seeded_and_of_all_sorts():
    mutated = runpy.run_path(str(SCRIPT))["mutated"]
    for content in (b"", b"x", b"1 2 3\n4 5 6\n" * 20, bytes(range(256)) * 4):
        made = [mutated(content, np.random.default_rng([1, i])) for i in range(200)]
        assert made == [mutated(content, np.random.default_rng([1, i])) for i in range(200)]
        assert len(set(made)) > (20 if len(content) < 2 else 150)
        assert len(content) < 2 or {len(m) > len(content) for m in made} == {True, False}
