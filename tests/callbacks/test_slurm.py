"""Jobs of Slurm, with a program that answers in the place of its scontrol."""

import pytest

from sips_lit.callbacks.slurm import in_job, requeue, started_again


@pytest.fixture
def scontrol(tmp_path, monkeypatch):
    """Puts a scontrol with this body on the path; returns what it was called with."""

    def install(body: str):
        program, told = tmp_path / "bin" / "scontrol", tmp_path / "told"
        program.parent.mkdir()
        program.write_text(f'#!/bin/sh\necho "$@" > {told}\n{body}\n')
        program.chmod(0o755)
        monkeypatch.setenv("PATH", str(program.parent), prepend=":")
        return told

    for name in ("SLURM_JOB_ID", "SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID", "SLURM_RESTART_COUNT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SLURM_JOB_ID", "12")
    return install


def test_a_job_is_started_again(scontrol):
    told = scontrol("exit 0")
    assert requeue() == "Slurm starts job 12 again"
    assert told.read_text() == "requeue 12\n"


def test_a_task_of_an_array_has_a_name_of_its_own(scontrol, monkeypatch):
    told = scontrol("exit 0")
    monkeypatch.setenv("SLURM_ARRAY_JOB_ID", "11")
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "3")
    assert requeue() == "Slurm starts job 11_3 again"
    assert told.read_text() == "requeue 11_3\n"


def test_a_refusal_is_told(scontrol):
    scontrol("echo 'Requested operation is presently disabled' >&2; exit 1")
    assert requeue() == "Slurm does not start job 12 again: Requested operation is presently disabled"


def test_where_there_is_no_scontrol_it_is_told(scontrol, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert requeue().startswith("Slurm can't be asked to start job 12 again: ")


def test_what_a_job_knows_of_itself(scontrol, monkeypatch):
    assert in_job()
    assert not started_again()  # Slurm sets the count from the second start on
    monkeypatch.setenv("SLURM_RESTART_COUNT", "1")
    assert started_again()
    monkeypatch.delenv("SLURM_JOB_ID")
    assert not in_job()
