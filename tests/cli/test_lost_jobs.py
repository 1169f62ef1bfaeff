"""A lost job of a cluster among others that run."""

import os
import signal
import time

import pytest
from hydra.core.utils import JobStatus
from omegaconf import OmegaConf

from sips_lit.cli.explain import JobFailed
from sips_lit.cli.lost_jobs import LostJobs, patient
from sips_lit.errors import InputWarning


def job(overrides: list[str]) -> int:
    (number,) = map(int, overrides)
    if number == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(1)
    return 10 * number


@pytest.mark.slow
def test_a_job_that_is_killed_fails_and_the_others_are_waited_for(tmp_path):
    submitit = pytest.importorskip("submitit", reason="needs the extra cluster")
    executor = patient(submitit.AutoExecutor)(folder=tmp_path, cluster="local")
    executor.update_parameters(timeout_min=1)
    with pytest.warns(InputWarning, match=r"job \d+ is lost \(\w+\): "):
        lost, *others = [started.results()[0] for started in executor.map_array(job, [["0"], ["1"], ["2"]])]
    assert others == [10, 20]
    assert lost.status == JobStatus.FAILED
    assert lost.overrides == ["0"]
    with pytest.raises(JobFailed, match=r"^a job failed: job \d+ is lost \(\w+\): "):
        lost.return_value  # noqa: B018 - raises, as Hydra's sweeper expects


class Executor:
    def map_array(self, function, items):
        return []


def test_it_is_changed_once():
    changed = patient(Executor)
    assert issubclass(changed, Executor)
    assert changed().map_array(len, []) == []  # no job
    assert patient(changed) is changed


@pytest.mark.parametrize(("launcher", "changed"), [("submitit_launcher.SlurmLauncher", True), ("basic.Basic", False)])
def test_only_launchers_of_submitit_are_changed(monkeypatch, launcher, changed):
    submitit = pytest.importorskip("submitit", reason="needs the extra cluster")
    before = submitit.AutoExecutor
    monkeypatch.setattr(submitit, "AutoExecutor", before)  # given back at the end
    target = {"_target_": f"hydra_plugins.{launcher}"}
    LostJobs().on_multirun_start(OmegaConf.create({"hydra": {"launcher": target}}))
    assert (submitit.AutoExecutor is not before) == changed
