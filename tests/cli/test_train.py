import os
import signal
from pathlib import Path

import cv2
import lightning as L
import numpy as np
import pytest
import torch
from cli_runs import write_frames
from lightning.pytorch.callbacks import ProgressBar
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from textured_scenes import flight, texture
from tiny_runs import CrashAt, StopAt, assert_equal_weights, config_of, run_it, scalars, target, two_kinds, weights

from sips_lit.callbacks.cards import card_of
from sips_lit.cli.train import make_callbacks
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError, TrainingInterrupted


class Poison(L.Callback):
    """Spoils the weights or the loss before a step."""

    def __init__(self, step: int, weights: bool) -> None:
        self.step, self.weights = step, weights

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        if trainer.global_step == self.step:
            if self.weights:
                next(pl_module.parameters()).data.fill_(float("nan"))
            else:
                batch.image0.fill_(float("nan"))


class KillWorker(L.Callback):
    """Kills a loading worker, as a machine without memory does."""

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        import torch.multiprocessing as mp

        for child in mp.active_children():
            os.kill(child.pid, signal.SIGKILL)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, frames) -> tuple[Path, float]:
    """Eight steps in one go, with validations after 3, 6 and at the end: the run that others are compared with."""
    run = tmp_path_factory.mktemp("whole") / "run"
    return run, run_it(run, frames, "trainer.max_steps=8", "trainer.val_check_interval=3")


def test_a_run_leaves_checkpoints_scalars_figures_and_pictures(whole):
    run, auc = whole
    assert 0 <= auc <= 1
    logged, events = scalars(run), EventAccumulator(str(run), {"images": 0}).Reload()
    for name in ("val/succinctness_auc", "val/failure_rate", "val/ece", "val/mce", "val/brier"):
        assert [step for step, _ in logged[name]] == [2, 5, 7]
    assert max(value for _, value in logged["val/succinctness_auc"]) == pytest.approx(auc)
    for name in ("val/curve", "val/reliability", "val/pair_0"):
        assert [e.step for e in events.Images(card_of(name).tag)] == [3, 6, 8]
    picture = cv2.imread(str(run / "pictures" / "matches_0.png"))
    assert picture.shape[1] >= 2 * 128
    assert picture.std() > 10
    for name in ("best", "last"):
        points = SipsDetector.from_checkpoint(run / "checkpoints" / f"{name}.ckpt")(texture(60, 80), n=9)
        assert 0 < len(points) <= 9


def test_training_scalars_are_logged(tmp_path, frames):
    run_it(tmp_path / "run", frames, "trainer.max_steps=4", "trainer.log_every_n_steps=2")
    logged = scalars(tmp_path / "run")
    for name in ("train/loss", "train/points", "labels/inlier", "labels/far", "inlier_rate/data", "lr-Adam"):
        assert len(logged[name]) == 2, name
    assert all(np.isfinite(value) for values in logged.values() for _, value in values)


@pytest.mark.parametrize("scheduler", [True, False])
@pytest.mark.parametrize("accumulate", [1, 3])
def test_the_learning_rate_is_logged_once_per_step(tmp_path, frames, accumulate, scheduler):
    steps = "trainer.max_steps=4", "trainer.log_every_n_steps=1", f"trainer.accumulate_grad_batches={accumulate}"
    run_it(tmp_path / "run", frames, *steps, f"optim={'adam_cosine' if scheduler else 'adam'}")
    logged = scalars(tmp_path / "run")["lr-Adam"]
    cosine = [1e-5 + (1e-3 - 1e-5) * (1 + np.cos(np.pi * step / 4)) / 2 for step in range(4)]
    assert [step for step, _ in logged] == [0, 1, 2, 3]
    assert [value for _, value in logged] == pytest.approx(cosine if scheduler else [1e-3] * 4, rel=1e-5)


def test_every_tag_has_a_description_and_a_group_by_use(whole):
    """Its kind, too: TensorBoard's server drops the description of a value whose kind it has to find out."""
    events = EventAccumulator(str(whole[0])).Reload()
    for kind in ("scalars", "images"):
        assert len(events.Tags()[kind]) >= 3
        for tag in events.Tags()[kind]:
            told = events.summary_metadata[tag]
            assert len(told.summary_description.split()) >= 5, tag
            assert (told.plugin_data.plugin_name, told.data_class > 0) == (kind, True), tag
    groups = {tag.partition("/")[0] for kind in ("scalars", "images") for tag in events.Tags()[kind]}
    assert groups == {"1_val", "2_train", "3_labels", "4_time", "5_run"}
    assert "custom_scalars__config__" in events.summary_metadata


def test_the_table_of_runs_has_the_settings_and_the_numbers_of_the_best_validation(whole):
    run, auc = whole
    logged = scalars(run)
    assert logged["best/succinctness_auc"][-1][1] == pytest.approx(auc)
    step = logged["best/succinctness_auc"][-1][0]
    assert dict(logged["best/ece"])[step] == dict(logged["val/ece"])[step - 1]
    events = EventAccumulator(str(run)).Reload()
    assert "_hparams_/session_start_info" in str(events.summary_metadata)
    told = events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    for setting in (b"data", b"KltInliers", b"ranking 30", b"depth 3, width 4", b"optim.optimizer.lr"):
        assert setting in told
    assert b"best AUC" in events.summary_metadata["_hparams_/experiment"].plugin_data.content


@pytest.mark.parametrize(("labelling", "loading"), [(3, 0), (1, 2)])
def test_a_seed_gives_one_run_whatever_the_workers(whole, tmp_path, frames, labelling, loading):
    workers = f"datamodule.labelling_workers={labelling}", f"datamodule.loading_workers={loading}"
    auc = run_it(tmp_path / "run", frames, "trainer.max_steps=8", "trainer.val_check_interval=3", *workers)
    assert auc == whole[1]
    assert_equal_weights(tmp_path / "run", whole[0])


def test_another_seed_gives_another_run(whole, tmp_path, frames):
    run_it(tmp_path / "run", frames, "trainer.max_steps=8", "trainer.val_check_interval=3", "seed=1")
    assert not torch.equal(next(iter(weights(tmp_path / "run").values())), next(iter(weights(whole[0]).values())))


@pytest.mark.parametrize(("step", "new_folder"), [(2, False), (4, True), (6, False)])
def test_an_interrupted_run_resumes_exactly(whole, tmp_path, frames, step, new_folder):
    run, again = tmp_path / "run", tmp_path / ("again" if new_folder else "run")
    steps = "trainer.max_steps=8", "trainer.val_check_interval=3", f"paths.outputs={tmp_path}"
    with pytest.raises(TrainingInterrupted, match=f"stopped at step {step} and saved .*last.ckpt"):
        run_it(run, frames, *steps, halt=target(StopAt, step=step))
    assert torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == step
    auc = run_it(again, frames, *steps, "ckpt_path=last")
    assert_equal_weights(again, whole[0])
    assert auc == whole[1]
    steps_validated = {step for folder in {run, again} for step, _ in scalars(folder).get("val/succinctness_auc", [])}
    assert sorted(steps_validated) == [2, 5, 7]


def test_a_crashed_run_resumes_exactly_from_its_last_validation(whole, tmp_path, frames):
    run = tmp_path / "run"
    steps = "trainer.max_steps=8", "trainer.val_check_interval=3"
    with pytest.raises(RuntimeError, match="power cut"):
        run_it(run, frames, *steps, crash=target(CrashAt, step=5))
    assert torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 3
    run_it(run, frames, *steps, "ckpt_path=last")
    assert_equal_weights(run, whole[0])
    steps_validated = sorted({step for step, _ in scalars(run)["val/succinctness_auc"]})
    assert steps_validated == [2, 5, 7]


def test_every_step_is_in_the_last_checkpoint(whole):
    stored = torch.load(whole[0] / "checkpoints" / "last.ckpt", weights_only=True)
    assert stored["global_step"] == 8


def test_a_stop_is_possible_though_every_step_validates(tmp_path, frames):
    steps = "trainer.max_steps=6", "trainer.val_check_interval=1"
    with pytest.raises(TrainingInterrupted, match="stopped at step 2"):
        run_it(tmp_path / "run", frames, *steps, halt=target(StopAt, step=2))
    run_it(tmp_path / "run", frames, *steps, "ckpt_path=last")
    assert sorted({step for step, _ in scalars(tmp_path / "run")["val/succinctness_auc"]}) == list(range(6))


def test_accumulated_gradients_resume_exactly(tmp_path, frames):
    steps = "trainer.max_steps=4", "trainer.accumulate_grad_batches=2", "trainer.val_check_interval=4"
    run_it(tmp_path / "one", frames, *steps)
    with pytest.raises(TrainingInterrupted):
        run_it(tmp_path / "two", frames, *steps, halt=target(StopAt, step=2))
    run_it(tmp_path / "two", frames, *steps, "ckpt_path=last")
    assert_equal_weights(tmp_path / "one", tmp_path / "two")


def test_weights_of_sources_that_follow_the_training_resume_exactly(tmp_path, frames):
    given = two_kinds(tmp_path / "root", frames)
    given += ["trainer.max_steps=34", "trainer.val_check_interval=34", "trainer.log_every_n_steps=1"]
    run_it(tmp_path / "one", None, *given, "module.focus=progress")
    with pytest.raises(TrainingInterrupted):
        run_it(tmp_path / "two", None, *given, "module.focus=progress", halt=target(StopAt, step=30))
    run_it(tmp_path / "two", None, *given, "module.focus=progress", "ckpt_path=last")
    assert_equal_weights(tmp_path / "one", tmp_path / "two")
    weighed = [value for _, value in scalars(tmp_path / "one")["source_weight/snow"]]
    assert weighed[0] == 1
    assert weighed[-1] != pytest.approx(1, abs=0.01)
    run_it(tmp_path / "fixed", None, *given)
    assert not torch.equal(
        next(iter(weights(tmp_path / "fixed").values())), next(iter(weights(tmp_path / "one").values()))
    )


def test_validations_are_counted_in_steps_of_several_pairs(tmp_path, frames):
    steps = "trainer.max_steps=6", "trainer.accumulate_grad_batches=3", "trainer.val_check_interval=2"
    run_it(tmp_path / "run", frames, *steps)
    # Lightning logs the number of the last step, counted from 0
    assert [step for step, _ in scalars(tmp_path / "run")["val/succinctness_auc"]] == [1, 3, 5]


def test_the_loss_falls(tmp_path, frames):
    run = tmp_path / "run"
    steps = "trainer.max_steps=60", "trainer.val_check_interval=60", "trainer.log_every_n_steps=1"
    run_it(run, frames, *steps, "optim.optimizer.lr=0.003", "optim.scheduler=null")
    losses = [value for _, value in scalars(run)["train/loss"]]
    assert len(losses) == 60
    assert np.mean(losses[-15:]) < np.mean(losses[:15])


@pytest.mark.parametrize("of_weights", [False, True])
def test_a_loss_that_is_not_finite_stops_the_run(tmp_path, frames, of_weights):
    run = tmp_path / "run"
    steps = "trainer.max_steps=8", "trainer.val_check_interval=3"
    with pytest.raises(BadInputError) as caught:
        run_it(run, frames, *steps, poison=target(Poison, step=4, weights=of_weights))
    assert "nan" in str(caught.value) or "not finite" in str(caught.value)
    assert all(torch.isfinite(w).all() for w in weights(run).values())
    if not of_weights:
        batch = torch.load(run / "nonfinite_batch.pt", weights_only=True)
        assert str(run / "nonfinite_batch.pt") in str(caught.value)
        assert torch.isnan(batch["image0"]).all()
        assert batch["reason0"].shape == batch["row0"].shape == batch["score0"].shape


def test_images_smaller_than_the_receptive_field(tmp_path):
    # 21 pixels are seen by a network of depth 10
    frames = write_frames(tmp_path / "tiny", flight(14, step=(0.4, 0.2), size=(20, 18)).frames)
    with pytest.raises(BadInputError, match="the training did not work"):  # there is no room for ten points
        run_it(tmp_path / "run", frames, "model.depth=10", "datamodule.overlap=0.1")
    assert all(torch.isfinite(w).all() for w in weights(tmp_path / "run").values())


def test_sequences_of_different_sizes(tmp_path):
    for i, size in enumerate([(128, 96), (101, 75)]):
        write_frames(tmp_path / "many" / f"part{i}", flight(14, size=size, seed=i).frames)
    assert np.isfinite(run_it(tmp_path / "run", tmp_path / "many", "trainer.max_steps=6"))


def test_a_validation_interval_longer_than_the_run(tmp_path, frames):
    assert np.isfinite(run_it(tmp_path / "run", frames, "trainer.max_steps=2", "trainer.val_check_interval=500"))


@pytest.mark.slow
def test_a_killed_loading_worker_ends_the_run(tmp_path, frames):
    from sips_lit.cli.explain import explain

    with pytest.raises(RuntimeError) as caught:
        run_it(
            tmp_path / "run", frames, "trainer.max_steps=500", "datamodule.loading_workers=2", kill=target(KillWorker)
        )
    assert "loading worker was killed" in explain(caught.value)


@pytest.mark.parametrize(("enabled", "count"), [("null", 1), ("true", 1), ("false", 0)])
def test_one_progress_display_or_none(tmp_path, frames, enabled, count):
    callbacks = make_callbacks(config_of(tmp_path / "run", frames, f"trainer.enable_progress_bar={enabled}"))
    displays = [callback for callback in callbacks if isinstance(callback, ProgressBar)]
    assert [display.seconds for display in displays] == [10] * count
    assert len(callbacks) > 5
