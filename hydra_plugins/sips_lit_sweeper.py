"""Hydra's door to a search by Optuna: Hydra takes sweepers from modules in the name space ``hydra_plugins`` only.

Hydra loads this with every command, so what takes time to load is loaded in the functions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

if TYPE_CHECKING:
    from sips_lit.cli.optuna_study import Proposal


class OptunaSweeper(Sweeper):
    """Jobs whose values follow from the scores of the jobs before (``conf/hydra/sweeper/optuna.yaml`` has the keys)."""

    def __init__(
        self, trials: int, at_once: int, seed: int, sampler: DictConfig, params: Mapping[str, str] | None = None
    ) -> None:
        self.trials, self.at_once, self.seed, self.sampler, self.params = trials, at_once, seed, sampler, params or {}

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Hydra's, before `sweep`."""
        self.context, self.hydra_context, self.config = hydra_context, hydra_context, config
        self.launcher: Launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Runs trials until there are ``trials``, those of earlier commands on this folder among them.

        Raises BadInputError where nothing can be searched, and where no trial has a score.
        """
        from sips_lit.cli.optuna_study import OptunaStudy, as_overrides, corners, described, split, values_now
        from sips_lit.errors import BadInputError

        for key, value in (("trials", self.trials), ("at_once", self.at_once)):
            if type(value) is not int or value < 1:
                raise BadInputError(f"hydra.sweeper.{key} is {value}: give a number from 1")
        assert self.config is not None
        given = [f"{key}={value}" for key, value in self.params.items()]
        loader = self.context.config_loader
        space, fixed = split(OverridesParser.create(config_loader=loader).parse_overrides([*given, *arguments]))
        self.validate_batch_is_legal([[*fixed, *as_overrides(values)] for values in corners(space)])
        folder = Path(self.config.hydra.sweep.dir)
        plain = loader.load_sweep_config(self.config, fixed)
        first = values_now(space, plain, plain.hydra.runtime.choices)
        folder.mkdir(parents=True, exist_ok=True)
        OmegaConf.save(self.config, folder / "multirun.yaml")
        study = OptunaStudy(folder, space, fixed, first, instantiate(self.sampler, _partial_=True), self.seed)
        print(described(study), flush=True)
        proposals = study.unfinished()
        while proposals or (proposals := study.propose(min(self.at_once, self.trials - study.begun))):
            for number, score in self._scores(proposals[: self.at_once], fixed, folder).items():
                study.tell(number, score)
            proposals = proposals[self.at_once :]
        if study.scored == 0:
            raise BadInputError("no trial of the search has a score: each tells above why")

    def _scores(self, proposals: Sequence[Proposal], fixed: Sequence[str], folder: Path) -> dict[int, float | None]:
        """By number of the trial; None where it failed. Those with consecutive numbers go to the launcher together."""
        from sips_lit.cli.optuna_study import as_overrides
        from sips_lit.cli.sweep_table import read_jobs
        from sips_lit.errors import warn_input

        scores: dict[int, float | None] = {}
        for _, group in groupby(enumerate(proposals), lambda at: at[1].number - at[0]):
            trials = [proposal for _, proposal in group]
            numbers = [trial.number for trial in trials]
            batch = [[*fixed, *as_overrides(trial.values)] for trial in trials]
            try:
                jobs = self.launcher.launch(batch, initial_job_idx=numbers[0])
                scores |= dict(zip(numbers, map(_score, jobs), strict=True))
            except Exception as error:  # what a launcher raises where a job was killed; the others' scores are in files
                kept = {job.folder.name: job.score for job in read_jobs(folder)}
                if not any(str(number) in kept for number in numbers):
                    raise  # no job began: it is the launcher that can't be used as it is set
                warn_input(f"the launcher lost a job of {', '.join(map(str, numbers))}: {error}")
                scores |= {number: kept.get(str(number)) for number in numbers}
        return scores


def _score(job: JobReturn) -> float | None:
    done = job.status == JobStatus.COMPLETED and isinstance(job.return_value, int | float)
    return float(job.return_value) if done else None
