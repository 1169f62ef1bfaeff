"""A search by Optuna: its space from the command line, its trials in a file of the sweep's folder (extra ``sweep``)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep, Override
from omegaconf import DictConfig, OmegaConf

from sips_lit.errors import BadInputError

try:
    import optuna
    from optuna.distributions import (
        BaseDistribution,
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
        distribution_to_json,
    )
    from optuna.samplers import BaseSampler
    from optuna.trial import TrialState
    from sqlalchemy import URL
    from sqlalchemy.exc import SQLAlchemyError
except ImportError as error:
    raise BadInputError("hydra/sweeper=optuna needs Optuna: pip install 'sips_lit[sweep]'") from error

FILE: Final = "study.db"
"""Optuna's SQLite file in the folder of a sweep."""
SEARCH: Final = "search"  # attribute of a study: what is searched
Space = Mapping[str, BaseDistribution]


@dataclass(frozen=True, slots=True)
class Proposal:
    """A trial that is to be run: its number, which is that of its job, and a value for each key of the space."""

    number: int
    values: Mapping[str, Any]


def as_overrides(values: Mapping[str, Any]) -> list[str]:
    """A point of the space as it stands on a command line."""
    return [f"{key}={value}" for key, value in values.items()]


def split(overrides: Sequence[Override]) -> tuple[dict[str, BaseDistribution], list[str]]:
    """The keys that are searched, and the overrides that are the same for all trials; the last of a key counts.

    ``a,b`` and ``choice(a,b)`` are choices; ``interval(0.1,1)`` numbers, ``int(interval(1,8))`` and ``range(1,9)`` whole
    ones, ``tag(log,interval(1e-4,1e-2))`` numbers by their orders of magnitude. Raises BadInputError for values that are
    none of these, and where nothing is searched.
    """
    space: dict[str, BaseDistribution] = {}
    fixed: dict[str, str] = {}
    for override in overrides:
        key = override.get_key_element()
        space.pop(key, None), fixed.pop(key, None)
        if override.is_sweep_override():
            try:
                space[key] = _distribution(override)
            except (ValueError, TypeError) as error:
                raise BadInputError(f"{override.input_line} can't be searched: {error}") from error
        else:
            fixed[key] = str(override.input_line)
    if not space:
        raise BadInputError(
            "nothing is searched: give a key several values (descriptor.size=6,8,12) or an interval "
            "(module.consistency=interval(0,1))"
        )
    return space, list(fixed.values())


def _distribution(override: Override) -> BaseDistribution:
    value = override.value()
    if isinstance(value, IntervalSweep):
        low, high, log = value.start, value.end, "log" in value.tags
        if isinstance(low, int) and isinstance(high, int):
            return IntDistribution(low, high, log=log)
        assert low is not None
        assert high is not None
        return FloatDistribution(low, high, log=log)
    texts = list(override.sweep_string_iterator())
    if not texts:
        raise ValueError("it has no values")
    numbers = [int(text) for text in texts if text.lstrip("-").isdecimal()]
    steps = {after - before for before, after in pairwise(numbers)}
    if override.is_range_sweep() and len(numbers) == len(texts) and len(steps) == 1 and min(steps) > 0:
        return IntDistribution(numbers[0], numbers[-1], step=min(steps))
    return CategoricalDistribution(texts)


def corners(space: Space) -> list[dict[str, Any]]:
    """Some points of the space in which every choice is at least once: what can be composed before anything runs."""
    values = [
        distribution.choices if isinstance(distribution, CategoricalDistribution) else [distribution.low]  # type: ignore[attr-defined]  # numbers
        for distribution in space.values()
    ]
    return [
        {key: of_key[at % len(of_key)] for key, of_key in zip(space, values, strict=True)}
        for at in range(max(map(len, values)))
    ]


def values_now(space: Space, config: DictConfig, choices: Mapping[str, Any]) -> dict[str, Any] | None:
    """The values that a configuration has, as a point of the space; None where it has none there.

    ``choices``: of its groups, as Hydra has them.
    """
    found: dict[str, Any] = {}
    for key, distribution in space.items():
        name = key.lstrip("+")
        value = choices[name] if name in choices else OmegaConf.select(config, name)
        if isinstance(distribution, CategoricalDistribution):
            same = [text for text in distribution.choices if _parsed(str(text)) == value]
            if not same:
                return None
            found[key] = same[0]
        else:
            low, high = distribution.low, distribution.high  # type: ignore[attr-defined]  # of both kinds of numbers
            if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
                return None
            if isinstance(distribution, IntDistribution) and (value - distribution.low) % distribution.step:
                return None
            found[key] = value
    return found


def _parsed(text: str) -> Any:
    return OverridesParser.create().parse_override(f"key={text}").value()


class OptunaStudy:
    """The trials of a search, which survive in ``folder``; the higher the score, the better.

    ``first``: the values of trial 0, if any. ``make_sampler`` gets a seed: each trial has its own, of ``seed`` and its
    number, so that a search that was interrupted proposes what it would have proposed. Raises BadInputError for a folder
    with another search, and for a file that is no study.
    """

    def __init__(
        self,
        folder: Path,
        space: Space,
        fixed: Sequence[str],
        first: Mapping[str, Any] | None,
        make_sampler: Callable[..., BaseSampler],
        seed: int,
    ) -> None:
        self.space, self.make_sampler, self.seed = space, make_sampler, seed
        self.file = folder / FILE
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        try:
            url = URL.create("sqlite", database=str(self.file.resolve())).render_as_string()
            self.study = optuna.create_study(storage=url, study_name="sweep", direction="maximize", load_if_exists=True)
            searched = self.study.user_attrs.get(SEARCH)
        except (SQLAlchemyError, optuna.exceptions.OptunaError, RuntimeError) as error:
            raise BadInputError(
                f"{self.file} is no study that Optuna {optuna.__version__} can read: give another hydra.sweep.dir"
            ) from error
        own = [*(f"{key}: {distribution_to_json(space[key])}" for key in space), *fixed]
        own = [text for text in own if not text.startswith("ckpt_path=")]
        if searched is None:
            self.study.set_user_attr(SEARCH, own)
            if first is not None:
                self.study.enqueue_trial(dict(first))
        elif sorted(searched) != sorted(own):
            different = ", ".join(sorted({*searched} ^ {*own}))
            raise BadInputError(
                f"{self.file} is of another search, which differs in {different}: give another hydra.sweep.dir"
            )
        for trial in self._trials(TrialState.RUNNING):
            if trial.params.keys() != space.keys():  # stopped while it was proposed
                self.study.tell(trial.number, state=TrialState.FAIL)

    def _trials(self, *states: TrialState) -> list[Any]:
        return list(self.study.get_trials(deepcopy=False, states=states))

    @property
    def begun(self) -> int:
        """Trials that were proposed, whatever became of them."""
        return len(self._trials(TrialState.RUNNING, TrialState.COMPLETE, TrialState.FAIL))

    @property
    def scored(self) -> int:
        """Trials with a score."""
        return len(self._trials(TrialState.COMPLETE))

    def unfinished(self) -> list[Proposal]:
        """Trials that were proposed and have neither a score nor failed: an earlier command was stopped meanwhile."""
        return [Proposal(trial.number, self._ordered(trial.params)) for trial in self._trials(TrialState.RUNNING)]

    def propose(self, count: int) -> list[Proposal]:
        """New trials."""
        proposals = []
        for _ in range(count):
            self.study.sampler = self.make_sampler(seed=_seed(self.seed, self.begun))
            trial = self.study.ask(dict(self.space))
            proposals.append(Proposal(trial.number, self._ordered(trial.params)))
        return proposals

    def _ordered(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {key: values[key] for key in self.space}

    def tell(self, number: int, score: float | None) -> None:
        """What became of a trial: its score, or that it failed (None or NaN)."""
        if score is None or not math.isfinite(score):
            self.study.tell(number, state=TrialState.FAIL)
        else:
            self.study.tell(number, score)


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def described(study: OptunaStudy) -> str:
    """Where the trials are, and how many."""
    return f"study: {study.file}, {study.begun} trials so far"
