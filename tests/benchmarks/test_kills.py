import os
import re
import runpy
import tempfile
from pathlib import Path

import pytest
import torch
from cli_runs import ROOT
from forked_commands import ForkedCommand

SCRIPT = ROOT / "benchmarks" / "kills.py"
SEED = 5  # its SIGTERM falls into a validation


@pytest.fixture(scope="module")
def differences():
    return runpy.run_path(str(SCRIPT))["differences"]


def state(**changes):
    whole = {"weights": torch.tensor([0.0, 1.0]), "step": 3, "loops": [{"done": True}], "score": float("nan")}
    return {**whole, **changes}


def test_equal_states_have_no_differences(differences):
    assert differences(state(), state()) == []


@pytest.mark.parametrize(
    "changes",
    [
        {"weights": torch.tensor([-0.0, 1.0])},  # equal as numbers, not as bits
        {"weights": torch.tensor([0.0, 1.0], dtype=torch.float64)},
        {"weights": torch.tensor([[0.0, 1.0]])},
        {"weights": [0.0, 1.0]},
        {"step": 4},
        {"step": 3.0},
        {"loops": [{"done": False}]},
        {"loops": []},
        {"loops": [{"done": True, "more": 1}]},
        {"score": 0.5},
    ],
)
def test_every_difference_is_found(differences, changes):
    assert len(differences(state(), state(**changes))) == 1
    assert len(differences(state(**changes), state())) == 1


@pytest.mark.slow
def test_killed_runs_end_as_the_undisturbed_one(tmp_path):
    """A small part of the trial of a hundred kills: one while a checkpoint is written, one SIGTERM, three SIGKILL."""
    shm, here = Path("/dev/shm"), Path(tempfile.gettempdir())  # not tmp_path: names of sockets must be short
    disks = here, shm if os.access(shm, os.W_OK) else here
    given = "--kills", "5", "--seed", SEED, "--disks", *disks
    trial = ForkedCommand(tmp_path, tmp_path / "log.txt", str(SCRIPT), *given)
    try:
        code = trial.wait(timeout=500)
    finally:
        trial.end()
    out = trial.log.read_text()
    assert code == 0, out
    assert "5 kills\n" in out
    assert "1 SIGTERM in: validation" in out
    runs, equal = re.search(r"(\d+) runs ended, .* (\d+) are bit-equal", out).groups()
    assert runs == equal
