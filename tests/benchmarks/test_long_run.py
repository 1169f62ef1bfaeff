import mmap
import runpy
from pathlib import Path

import numpy as np
import psutil
import pytest
from cli_runs import ROOT


@pytest.fixture(scope="module")
def long_run():
    return runpy.run_path(str(ROOT / "benchmarks" / "long_run.py"))


def rows(memory, files=9.0) -> np.ndarray:
    """A hundred samples; memory and files may differ along the run."""
    steps = 50 * np.arange(1, 101)
    columns = [steps, memory, files, 12, 20, 30]
    return np.stack([np.broadcast_to(np.asarray(column, float), steps.shape) for column in columns], 1)


def test_what_stays_is_within_its_limits(long_run, capsys):
    noise = np.random.default_rng(0).normal(0, 5, 100)
    assert long_run["report"](rows(500 + noise)) == []
    assert "5000 steps, 100 samples" in capsys.readouterr().out


def test_what_grows_is_over_its_limit(long_run):
    assert long_run["report"](rows(np.linspace(500, 600, 100))) == ["MB"]
    assert long_run["report"](rows(500, np.arange(100) // 10)) == ["open files"]


def test_the_warm_up_does_not_count(long_run):
    memory = np.full(100, 700.0)
    memory[:50] = 100  # of 5000 steps
    first, last = long_run["quarters"](rows(memory))
    assert (first[1], last[1]) == (700, 700)


def test_a_picture(long_run, tmp_path):
    long_run["draw"](rows(500), tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="only Linux tells")
def test_memory_without_files(long_run):
    own = psutil.Process()
    before = long_run["_own_bytes"](own)
    held = np.frombuffer(mmap.mmap(-1, 40_000_000), np.uint8)  # not of what this process has free
    held[:] = 1
    assert 39e6 < long_run["_own_bytes"](own) - before < 45e6
    assert before + held.nbytes < own.memory_info().rss + held.nbytes  # libraries do not count
