"""What a user sees of sips-train: interrupts, bad input, sweeps, resuming."""

import errno
import os
import re
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from cli_runs import TINY, write_frames
from forked_commands import ForkedCommand
from textured_scenes import flight, texture
from tiny_runs import scalars, two_kinds, weights


def given(frames, *more: str) -> list[str]:
    return [*TINY, "data=folder", f"data.path={frames}", *more]


LINE_A_STEP = "callbacks.progress.seconds=0"


def read_until(child: ForkedCommand, text: str, times: int = 1, seconds: float = 60) -> str:
    """Output of a process up to an occurrence of a text, the first or a later one."""
    end = time.monotonic() + seconds
    while (seen := child.log.read_text()).count(text) < times:
        assert time.monotonic() < end, seen
        assert child.poll() is None, seen
        time.sleep(0.02)
    return seen


def ended(child: ForkedCommand, seconds: float = 30) -> tuple[int, str]:
    code = child.wait(timeout=seconds)
    return code, child.log.read_text()


@pytest.mark.slow
def test_ctrl_c_saves_and_another_run_goes_on(process, command, frames, folders):
    run = f"hydra.run.dir={folders}/outputs/run"
    steps = "trainer.max_steps=5000", "trainer.val_check_interval=5000", "datamodule.loading_workers=1"
    child = process("train", *given(frames, *steps, run, LINE_A_STEP))
    read_until(child, "step 4/5000,")
    os.killpg(child.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    code, out = ended(child)
    assert code == 130, out
    assert "stopped at step" in out
    assert "Traceback" not in out
    last = folders / "outputs" / "run" / "checkpoints" / "last.ckpt"
    step = torch.load(last, weights_only=True)["global_step"]
    assert step >= 4
    again = f"hydra.run.dir={folders}/outputs/other", f"trainer.max_steps={step + 2}", "ckpt_path=last"
    result = command("train", *given(frames, *again))
    assert result.code == 0, result.err
    assert f"going on from {last}" in result.out
    stored = torch.load(folders / "outputs" / "other" / "checkpoints" / "last.ckpt", weights_only=True)
    assert stored["global_step"] == step + 2


@pytest.mark.slow
def test_a_second_ctrl_c_stops_at_once(process, frames, folders):
    # one step takes long here: the first signal would wait for it
    slow = "trainer.max_steps=5000", "trainer.val_check_interval=5000", "trainer.accumulate_grad_batches=100000"
    child = process("train", *given(frames, *slow, f"hydra.run.dir={folders}/run", LINE_A_STEP))
    read_until(child, "step 0/5000,", times=4)
    os.killpg(child.pid, signal.SIGINT)
    read_until(child, "stopping after this step")
    os.killpg(child.pid, signal.SIGINT)
    code, out = ended(child, 15)
    assert code == 130, out
    assert "Traceback" not in out
    assert not (folders / "run" / "checkpoints" / "last.ckpt").exists()


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["step", "validation"])
def test_sigterm_to_the_whole_group_saves_and_exits_with_143(process, frames, folders, phase):
    """As a scheduler sends it, twice, to the loading workers, too. (benchmarks/kills.py has all phases.)"""
    run = folders / "outputs" / "run"
    interval = 5000 if phase == "step" else 1  # nearly all of the time goes into validations
    steps = "trainer.max_steps=5000", f"trainer.val_check_interval={interval}", "datamodule.loading_workers=2"
    child = process("train", *given(frames, *steps, f"hydra.run.dir={run}", LINE_A_STEP))
    read_until(child, "step 2/5000,")
    for _ in range(2):
        os.killpg(child.pid, signal.SIGTERM)
        time.sleep(0.05)
    code, out = ended(child)
    assert code == 143, out
    assert "Traceback" not in out, out
    step = re.search(r"error: stopped at step (\d+) and saved", out)
    assert step is not None, out
    assert torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == int(step[1]) >= 2


def descendants(pid: int) -> list[int]:
    children = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return [*children, *(pid for child in children for pid in descendants(child))]


CRASH = """
import lightning as L
class CrashAt(L.Callback):
    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step == 23:
            raise RuntimeError("power cut")
"""


@pytest.mark.slow
def test_two_processes_are_one_run_which_a_sigterm_to_either_of_them_or_a_crash_interrupts(process, frames, folders):
    """Both stop, whichever gets it; and both go on to what two processes end with that nobody stopped, bit for bit.

    Each with the points that it had selected ahead.
    """
    outputs = folders / "outputs"
    two = "trainer.devices=2", "trainer.strategy=ddp", "trainer.max_steps=30", "trainer.val_check_interval=20"
    (folders / "crash.py").write_text(CRASH)  # in the working folder, which Python looks into

    def start(name: str, *more: str) -> ForkedCommand:
        arguments = given(frames, *two, f"hydra.run.dir={outputs}/{name}", LINE_A_STEP, *more)
        return process("train", *arguments, ranks=1)

    def stored(name: str, which: str = "last") -> dict:
        return torch.load(outputs / name / "checkpoints" / f"{which}.ckpt", weights_only=True)

    def stop(child: ForkedCommand, first: bool, step: int) -> None:
        read_until(child, f"step {step}/30,", seconds=120)
        (second,) = (p for p in descendants(child.pid) if "ddp_process" in Path(f"/proc/{p}/comm").read_text())
        os.kill(child.pid if first else second, signal.SIGTERM)
        code, out = ended(child)
        assert code == 143, out
        assert "Traceback" not in out
        assert out.count("stopped at step") == 1
        assert step <= stored("run")["global_step"] < 30

    code, out = ended(start("whole"), 120)
    assert code == 0, out
    assert "Traceback" not in out
    assert out.count("run folder: ") == out.count("best validation AUC") == 1
    assert [path.parents[1].name for path in outputs.rglob("last.ckpt")] == ["whole"]
    events = [path.suffixes for path in outputs.rglob("events.out.tfevents*")]
    assert len({process for *_, process, _ in events}) == 1
    stop(start("run"), first=False, step=2)
    code, out = ended(start("run", "ckpt_path=last", "+callbacks.crash._target_=crash.CrashAt"), 120)
    assert code != 0
    assert "power cut" in out
    assert stored("run")["global_step"] == 20
    stop(start("run", "ckpt_path=last"), first=True, step=22)
    code, out = ended(start("run", "ckpt_path=last"), 120)
    assert code == 0, out
    for which in ("last", "best"):
        one, other = stored("run", which), stored("whole", which)
        assert one["global_step"] == other["global_step"]
        for tensor, others in zip(one["state_dict"].values(), other["state_dict"].values(), strict=True):
            assert torch.equal(tensor, others)
    assert stored("run")["global_step"] == 30


def test_a_run_tells_what_it_wrote(command, frames, folders):
    result = command("train", *given(frames, f"hydra.run.dir={folders}/run"))
    assert result.code == 0, result.err
    for text in (f"run folder: {folders}/run", "precision: 32-true", "best validation AUC", "best.ckpt", "tensorboard"):
        assert text in result.out
    digest = re.search(r"on 2 fixed pairs \((\w{8})\)", result.out)
    assert digest is not None


def test_no_data_named(command):
    result = command("train")
    assert result.code == 1
    assert "data" in result.err
    assert "Traceback" not in result.err


def test_data_without_a_path(command):
    assert command("train", "data=folder").sentence.startswith("data.path is not set: add data.path=...")
    assert command("train", "data=video").sentence.startswith("data.path is not set: add data.path=...")


@pytest.mark.parametrize(
    "key", ["nonsense=1", "model.nonsense=1", "trainer.max_step=3", "datamodule.worker=1", "data=nonsense"]
)
def test_unknown_keys_are_refused_by_name(command, frames, key):
    result = command("train", *given(frames, key))
    assert result.code == 1
    assert key.split("=")[0].split(".")[-1] in result.err or "nonsense" in result.err
    assert "Traceback" not in result.err


@pytest.mark.parametrize("steps", [0, -1])
def test_training_is_counted_in_steps(command, frames, steps):
    assert "trainer.max_steps" in command("train", *given(frames, f"trainer.max_steps={steps}")).sentence


def test_impossible_values(command, frames):
    for key, text in (
        ("model.width=3", "width"),
        ("model.depth=1", "depth"),
        ("datamodule.val_fraction=2", "validation"),
        ("k=60", "n_max"),
        ("module.selector.nms_radius=-1", "nms_radius"),
    ):
        assert text in command("train", *given(frames, key)).sentence


def test_an_empty_folder(command, tmp_path):
    (tmp_path / "empty").mkdir()
    assert f"{tmp_path}/empty has no images" in command("train", *given(tmp_path / "empty")).sentence


def test_a_missing_folder(command, tmp_path):
    assert f"there is no folder {tmp_path}/gone" in command("train", *given(tmp_path / "gone")).sentence


def test_one_frame(command, tmp_path):
    assert "one image only" in command("train", *given(write_frames(tmp_path / "one", [texture(60, 80)]))).sentence


def test_too_few_frames_to_validate(command, tmp_path):
    few = write_frames(tmp_path / "few", flight(3).frames)
    assert "too short to keep 30% of each for validation" in command("train", *given(few)).sentence


def test_frames_that_do_not_overlap(command, tmp_path):
    cuts = write_frames(tmp_path / "cuts", [texture(80, 96, seed) for seed in range(16)])
    assert "no two frames of cuts_0to11 overlap" in command("train", *given(cuts, "datamodule.overlap=0.3")).sentence


def test_other_files_beside_images(command, tmp_path):
    folder = write_frames(tmp_path / "frames", flight(16, size=(96, 80)).frames)
    (folder / "times.txt").write_text("0.1\n")
    (folder / ".hidden.png").write_bytes(b"no image")
    result = command("train", *given(folder))
    assert result.code == 0, result.err


def test_a_video_without_frames(command, tmp_path):
    (tmp_path / "empty.mp4").write_bytes(b"")
    result = command("train", *TINY, "data=video", f"data.path={tmp_path}/empty.mp4")
    assert f"{tmp_path}/empty.mp4 is no video that can be read" in result.sentence


def test_validation_data_of_its_own(command, frames, tmp_path):
    other = write_frames(tmp_path / "other", flight(8, size=(96, 80), seed=7).frames)
    result = command("train", *given(frames, "data@val_data=folder", f"val_data.path={other}"))
    assert result.code == 0, result.err


def test_validation_data_without_a_path(command, frames):
    assert command("train", *given(frames, "data@val_data=folder")).sentence.startswith("val_data.path is not set")


def test_nothing_to_go_on_from(command, frames, tmp_path):
    gone = command("train", *given(frames, f"ckpt_path={tmp_path}/gone.ckpt"))
    assert f"there is no checkpoint {tmp_path}/gone.ckpt" in gone.sentence
    assert "there is no last.ckpt" in command("train", *given(frames, "ckpt_path=last")).sentence


def test_a_damaged_checkpoint_to_go_on_from(command, frames, tmp_path):
    (tmp_path / "bad.ckpt").write_bytes(b"not a checkpoint")
    assert f"{tmp_path}/bad.ckpt" in command("train", *given(frames, f"ckpt_path={tmp_path}/bad.ckpt")).sentence


def test_a_checkpoint_of_another_network_to_go_on_from(command, frames, folders):
    assert command("train", *given(frames, f"hydra.run.dir={folders}/outputs/a")).code == 0
    other = "model.width=6", f"ckpt_path={folders}/outputs/a/checkpoints/last.ckpt", f"hydra.run.dir={folders}/b"
    sentence = command("train", *given(frames, *other)).sentence
    assert "last.ckpt is of another run, with model.width=4 (here 6)" in sentence


def test_exported_weights_to_go_on_from(command, frames, checkpoint):
    assert "must be the .ckpt file of a run" in command("train", *given(frames, f"ckpt_path={checkpoint}")).sentence


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("val_check_interval=0", "trainer.val_check_interval is 0: set it to a number of steps"),
        ("val_check_interval=0.5", "trainer.val_check_interval is 0.5"),
        ("accumulate_grad_batches=0", "trainer.accumulate_grad_batches is 0: set it to a number of pairs"),
        ("limit_val_batches=0", "trainer.limit_val_batches is 0: checkpoints are saved after validations"),
        ("check_val_every_n_epoch=0", "trainer.check_val_every_n_epoch is 0: leave it null, a run is one epoch"),
        ("check_val_every_n_epoch=2", "trainer.check_val_every_n_epoch is 2: leave it null"),
        ("limit_val_batches=0.01", "Try at least `limit_val_batches=0.5`"),
    ],
)
def test_a_run_that_would_not_validate_is_refused(command, frames, key, text):
    assert text in command("train", *given(frames, f"trainer.{key}")).sentence


NO_INLIER = "inliers.threshold=1e-9"


@pytest.mark.parametrize(
    ("without", "why"),
    [
        ((NO_INLIER,), r"no validation pair has an inlier \(of the points .*too far"),
        (("module.selector.nms_radius=100",), r"no validation pair have more than \d points, and k = 10"),
        (("k=36", "module.points=36"), r"no validation pair has k = 36 inliers .* the best has \d+: train longer"),
    ],
)
def test_a_training_that_did_not_work_is_an_error_with_its_reason(command, frames, folders, without, why):
    result = command("train", *given(frames, *without, f"hydra.run.dir={folders}/run"))
    told = r"the training did not work, its best validation AUC is 0: .*"
    assert re.fullmatch(told + why + ".*", result.sentence)
    assert re.search(f"warning: step 2: .*{why}", result.err)
    assert "best validation AUC 0.000" not in result.out
    assert (folders / "run" / "checkpoints" / "last.ckpt").is_file()


def test_a_training_without_any_inlier_ends_at_its_first_validation(command, frames, folders):
    steps = "trainer.max_steps=50", "trainer.val_check_interval=4", "callbacks.prospects.stretch=3"
    result = command("train", *given(frames, NO_INLIER, *steps, f"hydra.run.dir={folders}/run"))
    assert result.sentence.startswith(
        "there is nothing to learn: 4 training pairs had no inlier, and no validation pair"
    )
    assert "warning: 3 training pairs in a row had no inlier" in result.err


def test_a_search_goes_on_with_a_score_of_zero(command, frames, folders):
    result = command("train", "-m", *given(frames, "inliers.threshold=1e-9,3", f"hydra.sweep.dir={folders}/sweep"))
    assert result.code == 0, result.err
    assert result.err.count("warning: the training did not work") == 1
    assert result.out.count("best validation AUC") == 1


def test_fewer_points_than_inliers_are_refused_before_training(command, frames):
    assert "module.points is 9, and k = 10" in command("train", *given(frames, "module.points=9")).sentence


COMPARE = (
    "+evaluation@compare=default",
    "+compare.detectors=[sips,orb]",
    "+compare.descriptor=${descriptor}",
    "+compare.inliers=${inliers}",
    "compare.pairs=3",
    "compare.n=20",
    "compare.n_max=40",
    "compare.repeats=1",
    "compare.pictures=false",
)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ("compare.k=null", "compare: k is None: give a whole number"),
        ("compare.pairs=null", "compare: pairs has a value of the wrong type"),
        ("compare.features=null", "compare: features has a value of the wrong type"),
        ("compare.inliers=null", "compare: inliers is not set"),
        ("compare.detectors=null", "compare: detectors is None"),
        ("compare.detectors=[sips,siff]", "there is no detector siff: choose from"),
        ("compare.detectors=[{sips: {radius: 3}}]", "compare: detectors sets radius of sips"),
        ("compare.descriptor=null", "compare: sips can't be compared: "),
        ("compare.pairs_file=/gone/pairs.csv", "compare: the pair list /gone/pairs.csv can't be read"),
        ("compare.data.path=/gone/frames", "compare: there is no folder /gone/frames"),
        ("+compare.pair_sets.city.data=null", "compare: pair_sets.city: data is not set"),
        ("callbacks.checkpoint=null", "compare needs the best checkpoint of the run"),
    ],
)
def test_mistakes_in_the_comparison_are_found_before_training(command, frames, wrong, text, monkeypatch):
    monkeypatch.setattr("lightning.Trainer.fit", lambda *_, **__: pytest.fail("it trains"))
    data = f"+compare.data={{_target_: sips_lit.frames.folder.folder, path: {frames}}}"
    assert text in command("train", *given(frames, *COMPARE, data, wrong)).sentence


def test_a_comparison_that_was_checked_changes_nothing_of_the_training(command, frames, folders):
    data = f"+compare.data={{_target_: sips_lit.frames.folder.folder, path: {frames}}}"
    assert command("train", *given(frames, f"hydra.run.dir={folders}/plain")).code == 0
    result = command("train", *given(frames, *COMPARE, data, f"hydra.run.dir={folders}/compared"))
    assert result.code == 0, result.err
    assert (folders / "compared" / "compare" / "results.json").is_file()
    plain, compared = (
        torch.load(folders / run / "checkpoints" / "last.ckpt", weights_only=True)["state_dict"]
        for run in ("plain", "compared")
    )
    assert all(torch.equal(plain[name], compared[name]) for name in plain)


def test_a_full_disk(command, frames, monkeypatch):
    def full(*_args, **_options):
        raise OSError(errno.ENOSPC, "No space left on device", "/disk/last.ckpt")

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", full)
        assert "cannot write /disk/last.ckpt: the disk / is full" in command("train", *given(frames)).sentence


def test_outputs_on_a_disk_that_is_really_full(command, frames, full_disk):
    run = full_disk / "run"
    assert command("train", *given(frames, f"hydra.run.dir={run}")).code == 0
    before = (run / "checkpoints" / "last.ckpt").read_bytes()
    (full_disk / "all").write_bytes(bytes(shutil.disk_usage(full_disk).free))
    nothing = command("train", *given(frames, f"hydra.run.dir={full_disk}/other"))  # not even Hydra's own files
    assert f"the disk {full_disk} is full" in nothing.sentence
    (full_disk / "all").unlink()
    rest = shutil.disk_usage(full_disk).free
    (full_disk / "others").write_bytes(bytes(rest - 24_000))  # enough for the log, not for a checkpoint
    again = command("train", *given(frames, f"hydra.run.dir={run}", "trainer.max_steps=4", "ckpt_path=last"))
    assert f"the disk {full_disk} is full" in again.sentence
    assert (run / "checkpoints" / "last.ckpt").read_bytes() == before
    (full_disk / "others").unlink()
    again = command("train", *given(frames, f"hydra.run.dir={run}", "trainer.max_steps=4", "ckpt_path=last"))
    assert again.code == 0, again.err
    assert torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 4


@pytest.mark.parametrize("damage", ["half", "bit"])
def test_a_damaged_last_checkpoint_falls_back_to_the_one_before(command, frames, folders, damage):
    run = f"hydra.run.dir={folders}/outputs/run"
    steps = "trainer.max_steps=4", "trainer.val_check_interval=2"
    assert command("train", *given(frames, run, *steps)).code == 0
    last = folders / "outputs" / "run" / "checkpoints" / "last.ckpt"
    whole, content = torch.load(last, weights_only=True)["state_dict"], bytearray(last.read_bytes())
    if damage == "bit":
        content[content.find(next(iter(whole.values())).numpy().tobytes()) + 3] ^= 64
    last.write_bytes(content[: len(content) // 2] if damage == "half" else content)
    again = command("train", *given(frames, run, *steps, "ckpt_path=last"))
    assert again.code == 0, again.err
    warnings = [line for line in again.err.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 1
    assert f"{last} is damaged: going on from the checkpoint before it" in warnings[0]
    stored = torch.load(last, weights_only=True)
    assert stored["global_step"] == 4
    assert all(torch.equal(stored["state_dict"][name], whole[name]) for name in whole)


def test_a_log_on_a_full_disk(command, frames, monkeypatch):
    def full(*_args, **_options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tensorboard.summary.writer.record_writer.RecordWriter.write", full)
    assert "is full: free some space on it" in command("train", *given(frames)).sentence


@pytest.mark.parametrize(
    "key",
    [
        "paths.indexes",
        "paths.run",
        "hydra.run.dir",
        "logger.save_dir",
        "callbacks.pictures.folder",
        "callbacks.checkpoint.dirpath",
        "callbacks.last_checkpoint.dirpath",
    ],
)
def test_a_folder_that_cannot_be_written(command, frames, tmp_path, key):
    (tmp_path / "file").write_text("")
    assert f"{tmp_path}/file" in command("train", *given(frames, f"{key}={tmp_path}/file/below")).sentence


def test_a_sweep_folder_that_cannot_be_written(command, frames, tmp_path):
    (tmp_path / "file").write_text("")
    sweep = f"hydra.sweep.dir={tmp_path}/file/below", "seed=1,2"
    assert f"{tmp_path}/file" in command("train", "-m", *given(frames, *sweep)).sentence


def test_a_sweep_runs_its_jobs_in_folders_of_their_own(command, frames, folders):
    result = command("train", "-m", *given(frames, "model.width=4,6", f"hydra.sweep.dir={folders}/sweep"))
    assert result.code == 0, result.err
    jobs = sorted(p.parents[1] for p in (folders / "sweep").rglob("best.ckpt"))
    assert len(jobs) == 2
    widths = [torch.load(j / "checkpoints" / "best.ckpt", weights_only=True)["hyper_parameters"] for j in jobs]
    assert sorted(w["network"]["width"] for w in widths) == [4, 6]


@pytest.mark.slow
def test_a_sweep_side_by_side(command, frames, folders, monkeypatch):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="needs the extra sweep")
    from joblib.externals.loky import get_reusable_executor

    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    options = "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"hydra.sweep.dir={folders}/sweep"
    own = "trainer.precision=${fast_precision:}"  # known in the processes of the launcher, too
    try:
        result = command(
            "train", "-m", *given(frames, "model.width=4,6", own, "datamodule.loading_workers=1", *options)
        )
    finally:
        get_reusable_executor().shutdown(kill_workers=True)
    assert result.code == 0, result.err
    assert len(list((folders / "sweep").rglob("best.ckpt"))) == 2


def test_a_scene_without_texture(command, tmp_path):
    grey = write_frames(tmp_path / "grey", [np.full((60, 80), 90, np.uint8)] * 16)
    assert "overlap" in command("train", *given(grey)).sentence


def validated(run) -> dict[str, float]:
    """The numbers of the one validation of a run."""
    return {name: values[-1][1] for name, values in scalars(run).items() if name.startswith("val/")}


@pytest.mark.slow
@pytest.mark.parametrize(("processes", "pairs"), [(2, 5), (3, 2)])
def test_every_pair_validates_once_whatever_the_number_of_processes(
    process, command, frames, folders, processes, pairs
):
    """An average would count a pair twice; of three processes one has no pair of its own."""
    one, several = folders / "one", folders / "several"
    same = "optim.optimizer.lr=0", "optim.scheduler=null", "trainer.max_steps=1", f"datamodule.val_pairs={pairs}", "k=3"
    assert command("train", *given(frames, *same, f"hydra.run.dir={one}")).code == 0
    ddp = f"trainer.devices={processes}", "trainer.strategy=ddp", f"hydra.run.dir={several}"
    code, out = ended(process("train", *given(frames, *same, *ddp), ranks=processes - 1), 90)
    assert code == 0, out
    assert {"val/succinctness_auc", "val/ece", "val/mce", "val/brier"} <= validated(one).keys()
    assert 0 < validated(one)["val/succinctness_auc"] < 1
    assert validated(several) == validated(one)


@pytest.mark.slow
def test_two_processes_learn_what_one_does_that_takes_the_pairs_of_both_a_step(process, frames, folders):
    """Gradients are averaged, over processes as over the pairs of a step; points are selected before the same steps.

    In the processes the network sees the pairs of a step at once, in the single one each by itself. The second process is
    one that Lightning starts, as for a user.
    """
    runs = {name: folders / name for name in ("one", "two", "single")}
    same = "trainer.max_steps=4", "trainer.val_check_interval=4", "trainer.precision=32-true", "optim.optimizer.lr=0.01"
    more = {
        "one": ["trainer.accumulate_grad_batches=4"],
        "two": [
            "trainer.devices=2",
            "trainer.strategy=ddp",
            "trainer.accumulate_grad_batches=2",
            "module.pairs_at_once=2",
        ],
        "single": [],  # a pair a step: what must differ
    }
    for name, options in more.items():
        arguments = given(frames, *same, *options, f"hydra.run.dir={runs[name]}")
        code, out = ended(process("train", *arguments), 90)
        assert code == 0, out
    one, two, single = (weights(run) for run in runs.values())
    for name, of_one in one.items():
        torch.testing.assert_close(two[name], of_one, rtol=0, atol=1e-5)
    assert max((single[name] - of_one).abs().max() for name, of_one in one.items()) > 1e-3


@pytest.mark.slow
def test_two_processes_weigh_sources_as_one_does_that_takes_the_pairs_of_both_a_step(process, frames, folders):
    given = [*TINY, *two_kinds(folders / "root", frames), "module.focus=difficulty", "optim.optimizer.lr=0.01"]
    given += ["trainer.max_steps=24", "trainer.val_check_interval=24", "trainer.log_every_n_steps=1"]
    ways = {
        "one": ["trainer.accumulate_grad_batches=2"],
        "two": ["trainer.devices=2", "trainer.strategy=ddp"],
    }
    focus = {}
    for name, options in ways.items():
        code, out = ended(process("train", *given, *options, f"hydra.run.dir={folders / name}"), 240)
        assert code == 0, out
        stored = torch.load(folders / name / "checkpoints" / "last.ckpt", weights_only=True)
        focus[name] = stored["source_focus"]
    assert focus["one"].keys() == focus["two"].keys() == {"snow", "office"}
    for source, (fast, slow, steps) in focus["one"].items():
        assert steps > 10
        assert focus["two"][source] == pytest.approx([fast, slow, steps], abs=1e-5)
    assert scalars(folders / "one")["source_weight/office"][-1][1] != pytest.approx(1, abs=0.01)
    for name, of_one in weights(folders / "one").items():
        torch.testing.assert_close(weights(folders / "two")[name], of_one, rtol=0, atol=1e-5)
