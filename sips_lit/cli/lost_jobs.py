"""A job that a cluster loses is a job that failed: the others of its sweep are waited for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from sips_lit.cli.explain import JobFailed, plain_warnings
from sips_lit.errors import warn_input


class LostJobs(Callback):
    """Has the launchers of submitit wait for all jobs of a sweep; by themselves they leave at the first that is lost."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Changes how submitit starts jobs, in this process."""
        plain_warnings()
        if "submitit" in str(config.hydra.launcher._target_):
            import submitit  # an extra

            submitit.AutoExecutor = patient(submitit.AutoExecutor)  # type: ignore[misc]  # there is no other place for it


def patient(executor: type[Any]) -> type[Any]:
    """An executor of submitit whose jobs end with a result, whatever becomes of them; once is enough."""
    if executor.__module__ == __name__:
        return executor

    def map_array(self: Any, run: Any, overrides: Sequence[Sequence[str]], *more: Any) -> list[_Settled]:
        return list(map(_Settled, executor.map_array(self, run, overrides, *more), overrides))

    return type(executor.__name__, (executor,), {"map_array": map_array})


class _Settled:
    """What the launcher asks of a job."""

    def __init__(self, job: Any, overrides: Sequence[str]) -> None:
        self.job, self.overrides = job, overrides

    def results(self) -> list[Any]:
        """What the job returned, or that it is lost."""
        try:
            returned: list[Any] = self.job.results()
        except Exception as error:  # submitit's, of a job that was killed, or whose file can't be read
            why = f"job {self.job.job_id} is lost ({self.job.state}): {str(error).strip().splitlines()[-1]}"
            warn_input(why)
            failure = JobFailed(f"a job failed: {why}")
            return [JobReturn(overrides=self.overrides, status=JobStatus.FAILED, _return_value=failure)]
        return returned
