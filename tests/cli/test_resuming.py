"""A run goes on: as if it had not been interrupted, longer or shorter, and only from a checkpoint of its own."""

import os
import re
import shutil
from pathlib import Path

import lightning as L
import numpy as np
import pytest
import torch
from cli_runs import TINY
from tiny_runs import StopAt, assert_equal_weights, config_of, run_it, scalars, target

from sips_lit.callbacks.guard import GracefulStop
from sips_lit.cli.resuming import differences, find_start, record_of
from sips_lit.errors import BadInputError, InputWarning, TrainingInterrupted

# the second validation is the best here, and later ones are worse
STEPS = (  # so fast that it is best before its end
    "trainer.max_steps=8",
    "trainer.val_check_interval=2",
    "callbacks.average={_target_: sips_lit.callbacks.averaging.AveragedWeights, steps: 100}",
    "optim.optimizer.lr=0.1",
    "model.derivatives=false",
    "model.octaves=1",
    "model.corners=0",
    "module.selector.border=0",
    "~callbacks.pictures",
)


class Snapshots(GracefulStop):
    """Saves after each step what a stop there saves, and goes on: the run folder goes to ``after<step>`` beside it."""

    def _stop_if_asked(self, trainer) -> None:
        trainer.save_checkpoint(self.checkpoint)
        run = self.checkpoint.parents[1]
        shutil.copytree(run / "checkpoints", run.with_name(f"after{trainer.global_step}") / "checkpoints")


@pytest.fixture(scope="module")
def whole(tmp_path_factory, frames) -> tuple[Path, float]:
    """The run folder and AUC of a run that is not interrupted."""
    run = tmp_path_factory.mktemp("whole") / "run"
    snapshots = target(Snapshots, checkpoint=str(run / "checkpoints" / "last.ckpt"))
    return run, run_it(run, frames, *STEPS, stop=snapshots)


def stored(run: Path, name: str) -> dict:
    return torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True)


def best_state(checkpoint: dict) -> dict:
    (state,) = (s for key, s in checkpoint["callbacks"].items() if "val/succinctness_auc" in key)
    return state


def interrupted(run: Path, frames: Path, step: int, *more: str) -> Path:
    """A run that was stopped after a step; its last checkpoint."""
    with pytest.raises(TrainingInterrupted):
        run_it(run, frames, *STEPS, *more, halt=target(StopAt, step=step))
    return run / "checkpoints" / "last.ckpt"


def assert_same_end(run: Path, auc: float, whole: tuple[Path, float]) -> None:
    """Weights, optimiser, best checkpoint and its score are those of the whole run, bit for bit."""
    assert auc == whole[1]
    for name in ("last", "best"):
        assert_equal_weights(run, whole[0], name)
        one, other = stored(run, name), stored(whole[0], name)
        assert one["global_step"] == other["global_step"]
        assert best_state(one)["best_model_score"] == best_state(other)["best_model_score"]
        for moment in ("exp_avg", "exp_avg_sq"):
            states = [c["optimizer_states"][0]["state"] for c in (one, other)]
            assert all(torch.equal(states[0][i][moment], states[1][i][moment]) for i in states[1])
        assert one["lr_schedulers"] == other["lr_schedulers"]
        assert all(w.equal(other["current_model_state"][name]) for name, w in one["current_model_state"].items())
    assert best_state(stored(run, "last"))["best_model_path"] == str(run / "checkpoints" / "best.ckpt")


@pytest.fixture
def stopped(whole, tmp_path) -> Path:
    """The last checkpoint of the same run stopped after five steps."""
    return stopped_after(5, whole, tmp_path / "stopped")


def stopped_after(step: int, whole: tuple[Path, float], run: Path) -> Path:
    """The last checkpoint of a folder of that run stopped after a step."""
    shutil.copytree(whole[0].with_name(f"after{step}"), run)
    return run / "checkpoints" / "last.ckpt"


def test_the_whole_run_is_best_before_its_end(whole):
    best, last = (stored(whole[0], name)["global_step"] for name in ("best", "last"))
    assert 0 < best < last  # else what follows would not tell a run that goes on from one that begins again
    assert [step for step, value in scalars(whole[0])["val/succinctness_auc"] if value == max(
        v for _, v in scalars(whole[0])["val/succinctness_auc"])] == [3]  # fmt: skip


@pytest.mark.parametrize(("step", "folder"), [(1, "again"), (4, "run"), (4, "again"), (5, "again"), (7, "run")])
def test_interrupted_is_uninterrupted_in_any_folder(whole, tmp_path, frames, step, folder):
    if (step, folder) == (4, "again"):
        interrupted(tmp_path / "run", frames, step)  # the others are snapshots of such a stop
    else:
        stopped_after(step, whole, tmp_path / "run")
    auc = run_it(tmp_path / folder, frames, *STEPS, f"paths.outputs={tmp_path}", "ckpt_path=last")
    assert_same_end(tmp_path / folder, auc, whole)


def test_what_is_saved_to_be_used_is_the_mean_of_the_weights(whole):
    last = stored(whole[0], "last")
    moved = [name for name, value in last["current_model_state"].items() if not value.equal(last["state_dict"][name])]
    assert len(moved) > 3


def test_a_job_that_slurm_starts_again_goes_on_from_its_own_checkpoint(whole, tmp_path, frames, monkeypatch, capsys):
    monkeypatch.setenv("SLURM_RESTART_COUNT", "1")
    elsewhere = stopped_after(1, whole, tmp_path / "elsewhere")
    run = stopped_after(5, whole, tmp_path / "run").parents[1]
    auc = run_it(run, frames, *STEPS, f"ckpt_path={elsewhere}")  # from where it began the first time
    assert f"going on from {run}/checkpoints/last.ckpt, step 5 of 8" in capsys.readouterr().out
    assert_same_end(run, auc, whole)


def test_a_job_of_slurm_that_had_saved_nothing_begins_anew(whole, tmp_path, frames, monkeypatch, capsys):
    monkeypatch.setenv("SLURM_RESTART_COUNT", "1")
    auc = run_it(tmp_path / "run", frames, *STEPS)
    assert "going on" not in capsys.readouterr().out
    assert_same_end(tmp_path / "run", auc, whole)


def test_a_teacher_goes_on_as_if_not_interrupted(whole, tmp_path, frames):
    teacher = "module.teacher_decay=0.7"
    auc = run_it(tmp_path / "whole", frames, *STEPS, teacher)
    stopped = interrupted(tmp_path / "run", frames, 5, teacher)
    assert run_it(tmp_path / "again", frames, *STEPS, teacher, f"ckpt_path={stopped}") == auc
    assert_equal_weights(tmp_path / "again", tmp_path / "whole", "last")
    with pytest.raises(AssertionError):  # other points were labelled
        assert_equal_weights(tmp_path / "whole", whole[0], "last")


def test_interrupted_twice_each_time_in_another_folder(whole, stopped, tmp_path, frames):
    shutil.copytree(stopped.parents[1], tmp_path / "a")
    second = interrupted(tmp_path / "b", frames, 6, f"ckpt_path={tmp_path}/a/checkpoints/last.ckpt")
    shutil.rmtree(tmp_path / "a")
    auc = run_it(tmp_path / "c", frames, *STEPS, f"ckpt_path={second}")
    assert_same_end(tmp_path / "c", auc, whole)


def test_a_last_checkpoint_alone_knows_where_the_best_is(whole, stopped, tmp_path, frames):
    shutil.copy(stopped, tmp_path / "last.ckpt")
    auc = run_it(tmp_path / "again", frames, *STEPS, f"ckpt_path={tmp_path}/last.ckpt")
    assert_same_end(tmp_path / "again", auc, whole)


def test_a_run_folder_that_was_moved(whole, stopped, frames):
    moved = stopped.parents[1]
    content = torch.load(stopped, weights_only=True)
    assert str(moved) not in str(best_state(content)["best_model_path"])
    assert_same_end(moved, run_it(moved, frames, *STEPS, "ckpt_path=last"), whole)


def test_killed_between_the_best_and_the_last_checkpoint(whole, tmp_path, frames):
    run = stopped_after(2, whole, tmp_path / "run").parents[1]
    shutil.copy(whole[0] / "checkpoints" / "best.ckpt", run / "checkpoints")  # as it was after step 4
    auc = run_it(tmp_path / "again", frames, *STEPS, f"ckpt_path={run}/checkpoints/last.ckpt")
    assert auc == whole[1]
    assert_equal_weights(tmp_path / "again", whole[0])
    assert_equal_weights(tmp_path / "again", whole[0], "best")


def of_seed_1(source: Path, copy: Path) -> None:
    """A copy of a checkpoint that says that its run had another seed."""
    content = torch.load(source, weights_only=True)
    content["run"]["identity"]["seed"] = 1
    copy.parent.mkdir(parents=True, exist_ok=True)
    torch.save(content, copy)


@pytest.mark.parametrize("kind", ["gone", "damaged", "of another run"])
def test_a_best_checkpoint_that_cannot_be_counted_is_told(stopped, tmp_path, frames, kind):
    last, best = stopped, stopped.with_name("best.ckpt")
    content = torch.load(last, weights_only=True)
    best_state(content)["best_k_models"] = {str(best): best_state(content)["best_model_score"]}
    best_state(content)["dirpath"] = str(best.parent)  # not where the best one of the whole run is
    torch.save(content, last)
    of_seed_1(best, best)
    if kind != "of another run":
        best.unlink()
    if kind == "damaged":
        best.write_bytes(b"half")
    score = re.escape(f"(val/succinctness_auc {float(best_state(content)['best_model_score']):.3f})")
    with pytest.warns(InputWarning, match=rf"best checkpoint so far, .*best\.ckpt {score}, is gone"):
        auc = run_it(tmp_path / "again", frames, *STEPS, f"ckpt_path={last}")
    assert auc == pytest.approx(max(value for _, value in scalars(tmp_path / "again")["val/succinctness_auc"]))
    assert stored(tmp_path / "again", "best")["global_step"] > 5


@pytest.mark.parametrize("folder", ["run", "again"])
def test_a_finished_run_says_so_and_reports_its_best(whole, tmp_path, frames, capsys, folder):
    shutil.copytree(whole[0], tmp_path / "run")
    auc = run_it(tmp_path / folder, frames, *STEPS, f"paths.outputs={tmp_path}", "ckpt_path=last")
    assert auc == whole[1]
    assert_equal_weights(tmp_path / folder, whole[0], "best")
    out = capsys.readouterr().out
    assert "step 8 of 8: the run is finished" in out
    assert f"best validation AUC {whole[1]:.3f}" in out
    assert f"checkpoint:  {tmp_path / folder}/checkpoints/best.ckpt" in out


class Rates(L.Callback):
    """Keeps the learning rate that each step is made with."""

    seen: dict[int, float]

    def on_train_start(self, trainer, pl_module) -> None:
        Rates.seen = {}

    def on_before_optimizer_step(self, trainer, pl_module, optimizer) -> None:
        Rates.seen[trainer.global_step] = optimizer.param_groups[0]["lr"]


def cosine(step: int, steps: int, high: float = 0.1, low: float = 1e-5) -> float:
    """The schedule by its formula."""
    return low + (high - low) * (1 + np.cos(np.pi * step / steps)) / 2


@pytest.mark.parametrize(("start", "steps"), [(5, 12), (8, 12), (5, 6)])
def test_a_longer_or_shorter_run_has_the_schedule_of_its_own_length(whole, stopped, tmp_path, frames, start, steps):
    last = whole[0] / "checkpoints" / "last.ckpt" if start == 8 else stopped
    length = f"trainer.max_steps={steps}"
    run_it(tmp_path / "again", frames, *STEPS, length, f"ckpt_path={last}", rates=target(Rates))
    assert list(Rates.seen) == list(range(start, steps))
    for step, rate in Rates.seen.items():
        assert rate == pytest.approx(cosine(step, steps), rel=1e-9)
    assert stored(tmp_path / "again", "last")["optimizer_states"][0]["param_groups"][0]["lr"] == pytest.approx(1e-5)


@pytest.mark.parametrize(
    "scheduler",
    [
        "{_target_:tiny_runs.polynomial,_partial_:true}",
        "{_target_:tiny_runs.one_cycle,_partial_:true}",
        "null",
    ],
    ids=["polynomial", "one cycle with momentum", "constant"],
)
def test_any_schedule_of_a_longer_run_is_that_of_a_run_begun_so_long(tmp_path, frames, scheduler):
    options = [
        "trainer.val_check_interval=12",
        "optim.optimizer.lr=0.002",
        "~optim.scheduler",
        f"+optim.scheduler={scheduler}",
    ]
    run_it(tmp_path / "long", frames, *STEPS, *options, "trainer.max_steps=12", rates=target(Rates))
    expected = Rates.seen
    last = interrupted(tmp_path / "short", frames, 5, *options)
    run_it(
        tmp_path / "again", frames, *STEPS, *options, "trainer.max_steps=12", f"ckpt_path={last}", rates=target(Rates)
    )
    assert Rates.seen == {step: rate for step, rate in expected.items() if step >= 5}
    if scheduler == "null":
        assert_equal_weights(tmp_path / "again", tmp_path / "long")


@pytest.mark.parametrize(("start", "steps"), [(5, 4), (5, 5), (8, 6)])
def test_a_run_shorter_than_what_is_done_is_refused(whole, stopped, tmp_path, frames, start, steps):
    last = whole[0] / "checkpoints" / "last.ckpt" if start == 8 else stopped
    with pytest.raises(
        BadInputError, match=rf"last.ckpt has made {start} of 8 steps, so trainer.max_steps={steps} leaves"
    ):
        run_it(tmp_path / "again", frames, *STEPS, f"trainer.max_steps={steps}", f"ckpt_path={last}")


OTHER = {
    "seed=1": r"seed=0 \(here 1\)",
    "model.width=6": r"model\.width=4 \(here 6\)",
    "optim.optimizer.lr=0.001": r"optim\.optimizer\.lr=0\.1 \(here 0\.001\)",
    "optim.scheduler.eta_min=0": r"optim\.scheduler\.eta_min=1e-05 \(here 0\)",
    "optim.scheduler=null": r"optim\.scheduler\._target_=torch",
    "callbacks.average.steps=9": r"callbacks\.average\.steps=100 \(here 9\)",
    "callbacks.average=null": r"callbacks\.average\._target_=sips_lit",
    "trainer.accumulate_grad_batches=2": r"trainer\.accumulate_grad_batches=1 \(here 2\)",
    "descriptor=orb": r"descriptor\._target_=sips_lit\.describe\.sift",
    "inliers.threshold=2": r"inliers\.threshold=3\.0 \(here 2\)",
    "augment.rotation=1": r"augment\.rotation=",
    "module.points=50": r"module\.points=40 \(here 50\)",
    "k=5": r"\bk=10 \(here 5\)",
    "n_max=80": r"n_max=60 \(here 80\)",
    "datamodule.overlap=0.2": r"datamodule\.overlap=0\.1 \(here 0\.2\)",
    "datamodule.val_pairs=3": r"datamodule\.val_pairs=2 \(here 3\)",
    "data.max_side=64": r"data\.max_side=None \(here 64\)",
}


@pytest.mark.parametrize("other", OTHER)
def test_a_checkpoint_of_another_run_is_refused_with_what_differs(whole, tmp_path, frames, other):
    last = whole[0] / "checkpoints" / "last.ckpt"
    more = [*STEPS, f"paths.outputs={whole[0]}", other]
    with pytest.raises(BadInputError, match=rf"{last} is of another run, with .*{OTHER[other]}"):
        run_it(tmp_path / "again", frames, *more, f"ckpt_path={last}")
    with pytest.raises(BadInputError, match=rf"the newest, {last}, is of another run, with .*{OTHER[other]}"):
        run_it(tmp_path / "again", frames, *more, "ckpt_path=last")


def test_other_frames_are_another_run_but_not_another_place(whole, tmp_path, frames):
    last = f"ckpt_path={whole[0]}/checkpoints/last.ckpt"
    moved = tmp_path / "elsewhere" / frames.name
    shutil.copytree(frames, moved, copy_function=shutil.copy2)
    assert run_it(tmp_path / "moved", moved, *STEPS, last) == whole[1]
    for file in moved.iterdir():
        os.utime(file)  # as a copy that keeps no times
    assert run_it(tmp_path / "copied", moved, *STEPS, last) == whole[1]
    shutil.copy(moved / "003.png", moved / "004.png")  # the same names and the same number
    with pytest.raises(BadInputError, match=rf"other frames \(by the names, .*, data.path={frames} \(here {moved}\)"):
        run_it(tmp_path / "changed", moved, *STEPS, last)
    validation = "data@val_data=folder", f"val_data.path={frames}"
    with pytest.raises(BadInputError, match=r"val_data=None \(here None\)|val_data\._target_=None"):
        run_it(tmp_path / "validated", frames, *STEPS, last, *validation)


def test_what_changes_speed_only_is_the_same_run(whole, stopped, tmp_path, frames):
    workers = "datamodule.labelling_workers=2", "datamodule.loading_workers=1", "trainer.log_every_n_steps=1"
    auc = run_it(tmp_path / "again", frames, *STEPS, *workers, f"ckpt_path={stopped}")
    assert_same_end(tmp_path / "again", auc, whole)


def test_another_precision_is_told(stopped, tmp_path, frames):
    told = r"trained with trainer\.precision=32-true, this run goes on with bf16-mixed"
    with pytest.warns(InputWarning, match=told):
        run_it(tmp_path / "again", frames, *STEPS, "trainer.precision=bf16-mixed", f"ckpt_path={stopped}")


def test_a_finished_run_whose_best_checkpoint_is_lost_has_no_score(whole, tmp_path, frames):
    last = stopped_after(8, whole, tmp_path / "run")
    (last.with_name("best.ckpt")).unlink()
    (whole[0] / "checkpoints" / "best.ckpt").rename(tmp_path / "hidden.ckpt")
    try:
        with (
            pytest.raises(BadInputError, match="no score: its best checkpoint is lost"),
            pytest.warns(InputWarning, match="is gone"),
        ):
            run_it(tmp_path / "again", frames, *STEPS, f"ckpt_path={last}")
    finally:
        (tmp_path / "hidden.ckpt").rename(whole[0] / "checkpoints" / "best.ckpt")


def test_the_time_that_a_run_may_take_is_its_own(tmp_path, frames, capsys):
    """Not that of the run which it goes on with, and whose time was over."""
    steps = "trainer.max_steps=100000", "trainer.val_check_interval=100000", "~callbacks.pictures"
    timed = run_it(tmp_path / "run", frames, *steps, "trainer.max_time=00:00:00:01")
    done = stored(tmp_path / "run", "last")["global_step"]
    assert f"max_time=00:00:00:01 ended the run after {done} of 100000 steps: ckpt_path=last" in capsys.readouterr().out
    assert run_it(tmp_path / "run", frames, *steps, "trainer.max_time=00:00:00:01", "ckpt_path=last") >= timed
    assert stored(tmp_path / "run", "last")["global_step"] > done


def test_last_is_the_newest_of_this_run(whole, stopped, tmp_path, frames, capsys):
    """Not of another seed, though that be newer, nor one that is damaged."""
    outputs = tmp_path / "outputs"
    for age, name in enumerate(("damaged", "other", "mine", "old")):
        last = outputs / name / "checkpoints" / "last.ckpt"
        of_seed_1(stopped, last)
        if name == "damaged":
            last.write_bytes(b"half")
        elif name != "other":
            shutil.copy(stopped, last)
        os.utime(last, (1e9 - age, 1e9 - age))
    with pytest.warns(InputWarning, match=r"damaged/checkpoints/last\.ckpt can't be read .*; it is passed over"):
        auc = run_it(tmp_path / "again", frames, *STEPS, f"paths.outputs={outputs}", "ckpt_path=last")
    assert_same_end(tmp_path / "again", auc, whole)
    assert f"going on from {outputs}/mine/checkpoints/last.ckpt, step 5 of 8" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("key", "text"),
    [("run", "does not tell of which run it is"), ("optimizer_states", "has no state of the optimiser")],
)
def test_a_checkpoint_that_lacks_what_going_on_needs(whole, tmp_path, frames, key, text):
    content = stored(whole[0], "last")
    del content[key]
    torch.save(content, tmp_path / "part.ckpt")
    with pytest.raises(BadInputError, match=rf"part\.ckpt {text}"):
        run_it(tmp_path / "again", frames, *STEPS, f"ckpt_path={tmp_path}/part.ckpt")


def sweep(frames: Path, folder: Path, *more: str) -> list[str]:
    return ["-m", *TINY, "data=folder", f"data.path={frames}", *STEPS, f"hydra.sweep.dir={folder}", *more]


def test_a_job_of_a_multirun_takes_no_checkpoint_but_its_own(command, stopped, frames, folders):
    shutil.copytree(stopped.parents[1], folders / "outputs" / "first" / "0")
    result = command("train", *sweep(frames, folders / "outputs" / "second", "seed=0,1", "ckpt_path=last"))
    assert result.code != 0
    assert result.err.count("error: in a multirun ckpt_path=last takes a job's own checkpoint, and no job in ") == 2
    assert not list((folders / "outputs" / "second").rglob("last.ckpt"))


def test_a_sweep_is_taken_up(command, whole, stopped, frames, folders):
    """The job of seed 0 was interrupted, that of seed 1 had not begun."""
    folder = folders / "outputs" / "sweep"
    shutil.copytree(stopped.parents[1], folder / "0")
    result = command("train", *sweep(frames, folder, "seed=0,1", "ckpt_path=last"))
    assert result.code == 0, result.err
    assert result.out.count("going on from") == 1
    assert f"going on from {folder}/0/checkpoints/last.ckpt, step 5 of 8\n" in result.out
    for name in ("last", "best"):
        assert_equal_weights(folder / "0", whole[0], name)
    assert stored(folder / "1", "last")["run"]["identity"]["seed"] == 1
    swapped = command("train", *sweep(frames, folder, "seed=1,0", "ckpt_path=last"))
    assert swapped.code != 0
    assert "seed=0 (here 1)" in swapped.err
    assert "seed=1 (here 0)" in swapped.err


COMPARE = (
    "+evaluation@compare=default",
    "+compare.detectors=[sips,grid]",
    "+compare.descriptor=${descriptor}",
    "+compare.data=${data}",
    "+compare.inliers=${inliers}",
    "compare.pairs=2",
    "compare.pictures=false",
)


@pytest.mark.parametrize("finished", [False, True])
def test_a_run_with_a_comparison_is_taken_up(command, whole, stopped, frames, folders, finished):
    """As the quickstart is, stopped in training or in the comparison after it: the best checkpoint is compared."""
    last = whole[0] / "checkpoints" / "last.ckpt" if finished else stopped
    own = f"ckpt_path={last}", f"hydra.run.dir={folders}/again"
    result = command("train", *TINY, "data=folder", f"data.path={frames}", *STEPS, *COMPARE, *own)
    assert result.code == 0, result.err
    assert f"best validation AUC {whole[1]:.3f}" in result.out
    assert_equal_weights(folders / "again", whole[0], "best")
    assert (folders / "again" / "compare" / "report.html").is_file()


@pytest.mark.parametrize(("seed", "val_seed", "goes_on"), [(0, 0, True), (1, 1, True), (1, 0, False)])
def test_a_run_from_before_val_seed_goes_on_with_the_same_validation_pairs(whole, seed, val_seed, goes_on):
    record = stored(whole[0], "last")["run"]
    identity = record["identity"]
    assert identity["val_seed"] == 0
    old = {key: value for key, value in identity.items() if key != "val_seed"} | {"seed": seed}
    now = {**record, "identity": {**identity, "seed": seed, "val_seed": val_seed}}
    different = differences({"run": {**record, "identity": old}}, now)
    assert different == ([] if goes_on else ["val_seed=1 (here 0)"])


def test_a_record_names_the_keys_that_a_user_sets(tmp_path, frames):
    config = config_of(tmp_path / "run", frames)
    trainer = type("Trainer", (), {"num_nodes": 2, "num_devices": 3})
    data = type("Data", (), {"data_digest": lambda self: "abc", "sample_digest": lambda self: "def"})()
    module = type("Module", (), {"learns_from": {"weights of teacher": "ghi"}})()
    record = record_of(config, data, trainer, module)
    assert record["identity"]["weights of teacher"] == "ghi"
    told = {"trainer.max_steps": 2, "trainer.precision": "32-true", "sample of frames": "def"}
    assert record["told"] == {"data.path": str(frames), "data.names": None, **told}
    expected = {"seed": 0, "k": 10, "n_max": 60, "model.width": 4, "optim.optimizer.lr": 1e-3, "processes": 6}
    assert expected.items() <= record["identity"].items()
    assert record["identity"]["frames"] == "abc"
    assert not any(key.endswith(("_workers", "index_folder", "gradient_costs")) for key in record["identity"])
    assert find_start(config, record) is None
