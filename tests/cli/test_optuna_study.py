"""A search: its space, what it proposes, and a study that survives. The objective is a formula, not a training."""

import math
import sys
from functools import partial

import pytest
from cli_runs import TINY
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from omegaconf import OmegaConf

pytest.importorskip("optuna")

import optuna

import sips_lit.cli.train
from sips_lit.cli.app import register_resolvers, run
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.optuna_study import FILE, OptunaStudy, as_overrides, corners, split, values_now
from sips_lit.cli.sweep_table import read_jobs
from sips_lit.errors import BadInputError

SPACE = ["rate=tag(log,interval(1e-4,1e-1))", "size=6,8,12", "depth=range(2,9,2)"]
FEW = partial(optuna.samplers.TPESampler, n_startup_trials=3)


def parsed(*overrides: str):
    return split(OverridesParser.create().parse_overrides(list(overrides)))


def opened(folder, overrides=SPACE, first=None, sampler=FEW, seed=0) -> OptunaStudy:
    return OptunaStudy(folder, *parsed(*overrides), first, sampler, seed)


def score(values) -> float:
    """Highest, 0, at a rate of 0.01, size 8 and depth 6."""
    return -abs(math.log10(values["rate"]) + 2) - (values["size"] != "8") - abs(values["depth"] - 6) / 2


def searched(study: OptunaStudy, count: int) -> None:
    for _ in range(count):
        (proposal,) = study.propose(1)
        study.tell(proposal.number, score(proposal.values))


def history(study: OptunaStudy) -> list:
    return [(trial.params, trial.value, trial.state.name) for trial in study.study.get_trials()]


def test_the_space_is_what_the_command_line_says():
    space, fixed = parsed(
        "a=1", *SPACE, "b=interval(0,2)", "c=int(interval(1,4))", "+d='x y',z", "a=2", "~e", "s=range(0,1,0.5)"
    )
    assert space == {
        "rate": optuna.distributions.FloatDistribution(1e-4, 1e-1, log=True),
        "size": optuna.distributions.CategoricalDistribution(["6", "8", "12"]),
        "depth": optuna.distributions.IntDistribution(2, 8, step=2),
        "b": optuna.distributions.FloatDistribution(0, 2),
        "c": optuna.distributions.IntDistribution(1, 4),
        "+d": optuna.distributions.CategoricalDistribution(["'x y'", "z"]),
        "s": optuna.distributions.CategoricalDistribution(["0.0", "0.5"]),
    }
    assert fixed == ["a=2", "~e"]
    assert parsed("a=1,2", "b=3,4", "a=5") == ({"b": optuna.distributions.CategoricalDistribution(["3", "4"])}, ["a=5"])


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["a=1"], "nothing is searched"),
        (["a=interval(2,1)"], r"a=interval\(2,1\) can't be searched"),
        (["a=tag(log,interval(0,1))"], "can't be searched"),
        (["a=range(3,3)"], "can't be searched: it has no values"),
    ],
)
def test_what_can_not_be_searched_is_refused(overrides, told):
    with pytest.raises(BadInputError, match=told):
        parsed(*overrides)


def test_values_now_are_a_point_of_the_space():
    space, _ = parsed(*SPACE, "model=small,tiny", "+new=null,3")
    config = OmegaConf.create({"rate": 1e-3, "size": 8.0, "depth": 4, "model": {"width": 3}})
    now = {"rate": 1e-3, "size": "8", "depth": 4, "model": "tiny", "+new": "null"}
    assert values_now(space, config, {"model": "tiny"}) == now
    for other in ({"rate": 0.2}, {"rate": None}, {"size": 7}, {"depth": True}, {"depth": 5}):
        assert values_now(space, OmegaConf.merge(config, other), {"model": "tiny"}) is None


def test_a_search_that_is_interrupted_goes_on_as_if_it_was_not(tmp_path):
    first = {"rate": 1e-3, "size": "6", "depth": 2}
    (tmp_path / "b # ?").mkdir()
    whole = opened(tmp_path, first=first)
    searched(whole, 6)
    assert history(whole)[0][0] == first
    for _ in range(2):
        searched(opened(tmp_path / "b # ?", first=first), 2)
    (left,) = opened(tmp_path / "b # ?", first=first).propose(1)  # and no score
    study = opened(tmp_path / "b # ?", first=first)
    assert study.unfinished() == [left]
    study.tell(left.number, score(left.values))
    searched(study, 1)
    assert history(study) == history(whole)
    assert study.begun == study.scored == 6


def test_another_seed_proposes_others_and_no_two_trials_are_the_same(tmp_path):
    proposed = []
    for seed in (0, 1):
        folder = tmp_path / str(seed)
        folder.mkdir()
        proposed += [proposal.values["rate"] for proposal in opened(folder, seed=seed).propose(5)]
    assert len(set(proposed)) == 10


def test_scores_decide_what_is_proposed_after_the_random_ones(tmp_path):
    proposed = []
    for sign in (1, -1):
        (tmp_path / str(sign)).mkdir()
        study = opened(tmp_path / str(sign))
        for _ in range(6):
            (proposal,) = study.propose(1)
            study.tell(proposal.number, sign * score(proposal.values))
        proposed.append([values for values, _, _ in history(study)])
    assert proposed[0][:3] == proposed[1][:3]
    assert proposed[0][3:] != proposed[1][3:]


def test_every_choice_is_in_a_corner():
    space, _ = parsed("a=1,2,3", "b=x,y", "c=interval(2,4)")
    found = corners(space)
    assert {values["a"] for values in found} == {"1", "2", "3"}
    assert {values["b"] for values in found} == {"x", "y"}
    assert {values["c"] for values in found} == {2}
    assert as_overrides(found[0]) == ["a=1", "b=x", "c=2.0"]


def test_what_failed_is_neither_scored_nor_run_again(tmp_path):
    study = opened(tmp_path)
    for number, result in enumerate([None, math.nan, math.inf, 0.5]):
        study.propose(1)
        study.tell(number, result)
    assert (study.begun, study.scored, study.unfinished()) == (4, 1, [])


def test_a_trial_without_all_its_values_failed(tmp_path):
    opened(tmp_path).study.ask({"size": optuna.distributions.CategoricalDistribution(["6", "8", "12"])})
    study = opened(tmp_path)
    assert (study.begun, study.scored, study.unfinished()) == (1, 0, [])


def test_a_folder_holds_one_search(tmp_path):
    opened(tmp_path, [*SPACE, "data=video"])
    opened(tmp_path, ["data=video", *reversed(SPACE), "ckpt_path=last"])
    with pytest.raises(BadInputError, match="is of another search, which differs in data=folder, data=video: give"):
        opened(tmp_path, [*SPACE, "data=folder"])
    with pytest.raises(BadInputError, match="differs in depth: "):
        opened(tmp_path, ["data=video", *SPACE[:2]])


def test_a_file_that_is_no_study(tmp_path):
    (tmp_path / FILE).write_bytes(b"no database" * 100)
    with pytest.raises(BadInputError, match=r"study\.db is no study"):
        opened(tmp_path)


# the command, with a formula in place of a training


class Objective:
    """Counts its calls; fails at k = 70, and is interrupted at the calls ``stops``."""

    def __init__(self) -> None:
        self.calls, self.stops = [], ()

    def __call__(self, config) -> float:
        self.calls.append((config.module.ranking, config.k))
        if len(self.calls) in self.stops:
            raise KeyboardInterrupt
        if config.k == 70:
            raise BadInputError("k is too large")
        return value(config.module.ranking)


def value(ranking: float) -> float:
    return 1 - abs(ranking - 50) / 50


@pytest.fixture
def objective(monkeypatch) -> Objective:
    made = Objective()
    monkeypatch.setattr(sips_lit.cli.train, "main", partial(run, "train", made))
    return made


@pytest.fixture
def search(command, folders):
    return partial(
        command, "train", "-m", "hydra/sweeper=optuna", f"hydra.sweep.dir={folders}/my search", "data.path=x"
    )


def test_a_failed_trial_does_not_stop_a_search(search, objective, folders):
    result = search("module.ranking=interval(0,100)", "k=10,70", "hydra.sweeper.trials=6")
    assert result.code == 0, result.err
    assert objective.calls[0] == (30, 10), "the recipe as it is comes first"
    assert {k for _, k in objective.calls} == {10, 70}
    assert result.err.count("error: k is too large") == sum(k == 70 for _, k in objective.calls)
    jobs = read_jobs(folders / "my search")
    assert [job.folder.name for job in jobs] == list("012345")
    best = max((job for job in jobs if job.problem is None), key=lambda job: job.score)
    assert f"best: AUC {best.score:.3f} in {best.folder}" in result.out
    assert "failed: k is too large" in result.out
    again = search("module.ranking=interval(0,100)", "k=10,70", "hydra.sweeper.trials=7")
    assert "my search/study.db, 6 trials so far" in again.out
    assert len(objective.calls) == 7


def test_a_search_that_was_stopped_is_taken_up_by_the_same_command(search, objective, folders):
    objective.stops = (3,)
    given = "module.ranking=interval(0,100)", "hydra.sweeper.trials=4", "hydra.sweeper.at_once=2"
    assert search(*given).code == 130
    assert len(objective.calls) == 3
    done = search(*given)
    assert done.code == 0, done.err
    assert objective.calls[3] == objective.calls[2], "the one that was interrupted"
    assert len(set(objective.calls)) == 4
    assert [job.folder.name for job in read_jobs(folders / "my search")] == list("0123")
    assert search(*given).code == 0
    assert len(objective.calls) == 5, "there was nothing left to do"


def launch_by(launch, monkeypatch) -> None:
    """Launchers launch by a function of what they would do, a batch, and the number of its first job."""
    make = Plugins.instantiate_launcher

    def instantiate(self, **given):
        launcher = make(self, **given)
        launcher.launch = partial(launch, launcher.launch)
        return launcher

    monkeypatch.setattr(Plugins, "instantiate_launcher", instantiate)


def test_a_job_that_is_killed_does_not_stop_a_search(search, objective, folders, monkeypatch):
    def losing(launch, batch, initial_job_idx):
        jobs = launch(batch, initial_job_idx=initial_job_idx)
        if initial_job_idx == 2:
            (folders / "my search" / "3" / ".hydra" / "result.yaml").unlink()
            raise RuntimeError("a worker was killed")
        return jobs

    launch_by(losing, monkeypatch)
    result = search("module.ranking=interval(0,100)", "hydra.sweeper.trials=5", "hydra.sweeper.at_once=2")
    assert result.code == 0, result.err
    assert "the launcher lost a job of 2, 3: a worker was killed" in result.err
    (study,) = optuna.get_all_study_summaries(f"sqlite:///{folders}/my search/{FILE}")
    trials = optuna.load_study(
        study_name=study.study_name, storage=f"sqlite:///{folders}/my search/{FILE}"
    ).get_trials()
    assert [trial.state.name for trial in trials] == ["COMPLETE", "COMPLETE", "COMPLETE", "FAIL", "COMPLETE"]
    assert [trial.value for trial in trials] == [
        None if at == 3 else value(r) for at, (r, _) in enumerate(objective.calls)
    ]


def test_a_launcher_that_can_not_start_stops_a_search(search, objective, monkeypatch):
    def unable(launch, batch, initial_job_idx):
        raise BadInputError("there is no cluster here")

    launch_by(unable, monkeypatch)
    assert search("k=10,20").sentence == "there is no cluster here"
    assert objective.calls == []


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["k=70,80", "module.ranking=7", "k=70,70"], "no trial of the search has a score"),
        (["k=10"], "nothing is searched"),
        (["k=10,20", "hydra.sweeper.trials=0"], "hydra.sweeper.trials is 0: give a number from 1"),
        (["k=10,20", "hydra.sweeper.at_once=many"], "hydra.sweeper.at_once is many: give a number from 1"),
        (["sed=10,20"], "reads the key sed: did you mean seed?"),
        (["model=small,tny"], "there is no model=tny: did you mean tiny?"),
    ],
)
def test_bad_input_is_one_sentence(search, objective, arguments, told):
    result = search("hydra.sweeper.trials=2", *arguments)
    assert result.code == 1
    assert "Traceback" not in result.err
    (last,) = [line for line in result.err.splitlines() if line.startswith("error: ")][-1:]
    assert told in last
    assert "a file of the configuration" not in last


def test_without_optuna_the_extra_is_named(search, objective, monkeypatch):
    monkeypatch.delitem(sys.modules, "sips_lit.cli.optuna_study")
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert search("k=10,20").sentence == "hydra/sweeper=optuna needs Optuna: pip install 'sips_lit[sweep]'"


def test_the_search_of_ones_own_recipe_begins_with_the_default():
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        config = compose("train", ["experiment=own_recipe", "data.path=x"], return_hydra_config=True)
        compose("train", ["experiment=own_recipe", "hydra/sweeper=basic", "data.path=x"])  # to compare what it found
        plain = compose("train", ["data.path=x"])
    space, fixed = parsed(*(f"{key}={value}" for key, value in config.hydra.sweeper.params.items()))
    assert fixed == []
    first = values_now(space, config, {})
    assert {key: float(value) for key, value in first.items()} == {key: OmegaConf.select(plain, key) for key in first}


@pytest.mark.slow
def test_trainings_side_by_side(command, frames, folders):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    given = (
        *TINY,
        "data=folder",
        f"data.path={frames}",
        "descriptor.size=tag(log,interval(6,12))",
        "module.ranking=0,30",
    )
    launcher = "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweeper.at_once=2"
    more = "hydra/sweeper=optuna", f"hydra.sweep.dir={folders}/s", "hydra.sweeper.trials=2"
    result = command("train", "-m", *launcher, *more, *given)
    assert result.code == 0, result.err
    jobs = read_jobs(folders / "s")
    assert len(jobs) == 2
    assert all(job.problem is None for job in jobs)
    kept = optuna.load_study(study_name=None, storage=f"sqlite:///{folders}/s/study.db").get_trials()
    assert [trial.value for trial in kept] == [job.score for job in jobs]
    assert kept[0].params != kept[1].params
