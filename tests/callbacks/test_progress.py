import sys
from types import SimpleNamespace

import lightning as L
import pytest
import torch
from lightning.pytorch.callbacks import ProgressBar, TQDMProgressBar
from streams import Clock, Stream

from sips_lit.callbacks.progress import TrainingBar, TrainingLines, training_progress


class Module(L.LightningModule):
    """A step takes two seconds of the clock and a validation pair three; logs as `SipsModule` does."""

    def __init__(self, clock: Clock):
        super().__init__()
        self.layer, self.clock = torch.nn.Linear(1, 1), clock

    def training_step(self, batch, batch_idx):
        self.clock.now += 2
        self.log("train/loss", 0.5 + batch_idx, prog_bar=True)
        self.log("inliers", 0.251, prog_bar=True, logger=False)
        return self.layer(batch).sum()

    def validation_step(self, batch, batch_idx):
        self.clock.now += 3

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 0.1)


def run(
    progress, folder, clock=None, steps=20, pairs_a_step=1, validate=100, ckpt_path=None, more=(), sanity=0
) -> L.Trainer:
    """A run with validations of four pairs; ``progress`` is the display, ``more`` are other callbacks."""
    pairs, val_pairs = (torch.utils.data.DataLoader(torch.ones(n, 1)) for n in (steps * pairs_a_step, 4))
    trainer = L.Trainer(
        max_steps=steps, accumulate_grad_batches=pairs_a_step, val_check_interval=validate, check_val_every_n_epoch=None,
        callbacks=[progress, *more], accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_model_summary=False, num_sanity_val_steps=sanity, default_root_dir=folder,
    )  # fmt: skip
    trainer.fit(Module(clock or Clock()), pairs, val_pairs, ckpt_path=ckpt_path)
    return trainer


def as_stderr(monkeypatch, terminal: bool) -> Stream:
    stream = Stream(terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def test_a_log_gets_a_line_per_ten_seconds(monkeypatch, tmp_path):
    err, clock = as_stderr(monkeypatch, terminal=False), Clock()
    run(TrainingLines(clock=clock), tmp_path, clock)
    assert err.lines == [
        "step 1/20, loss 0.50, inliers 0.25, 0.5 steps/s, 38 s left",
        "step 6/20, loss 5.50, inliers 0.25, 0.5 steps/s, 28 s left",
        "step 11/20, loss 10.50, inliers 0.25, 0.5 steps/s, 18 s left",
        "step 16/20, loss 15.50, inliers 0.25, 0.5 steps/s, 8 s left",
    ]


class Talks(L.Callback):
    """Prints before the first step and after the second."""

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if batch_idx in (0, 2):
            pl_module.print("something else")


@pytest.mark.parametrize("terminal", [False, True])
def test_what_else_is_printed_stands_between_the_lines(monkeypatch, tmp_path, capsys, terminal):
    err, clock = as_stderr(monkeypatch, terminal), Clock()
    run(TrainingBar() if terminal else TrainingLines(clock=clock), tmp_path, clock, more=[Talks()])
    assert capsys.readouterr().out == "something else\n" * 2
    if not terminal:
        assert [line.partition(",")[0] for line in err.lines] == [f"step {step}/20" for step in (0, 5, 10, 15, 20)]


@pytest.mark.parametrize(("seconds", "steps"), [(0, range(1, 9)), (4, [1, 3, 5, 7]), (100, [1])])
def test_how_often_is_chosen(monkeypatch, tmp_path, seconds, steps):
    err, clock = as_stderr(monkeypatch, terminal=False), Clock()
    run(TrainingLines(seconds, clock), tmp_path, clock, steps=8)
    assert [line.split(",")[0] for line in err.lines] == [f"step {step}/8" for step in steps]


def test_validations_have_lines_of_their_own(monkeypatch, tmp_path):
    err, clock = as_stderr(monkeypatch, terminal=False), Clock()
    run(TrainingLines(clock=clock), tmp_path, clock, steps=8, validate=4)
    assert [line for line in err.lines if line.startswith("validation")] == [
        "validation: 1/4 pairs (25 %), 9 s left",
        "validation: 1/4 pairs (25 %), 9 s left",
    ]
    # step 5 ends after 5 * 2 + 4 * 3 seconds: what is left is counted at that pace
    assert "step 5/8, loss 4.50, inliers 0.25, 0.23 steps/s, 13 s left" in err.lines


def test_a_resumed_run_counts_its_own_pace(monkeypatch, tmp_path):
    first = run(TrainingLines(), tmp_path, steps=6)
    first.save_checkpoint(tmp_path / "six.ckpt")
    err, clock = as_stderr(monkeypatch, terminal=False), Clock()
    run(TrainingLines(clock=clock), tmp_path, clock, steps=10, ckpt_path=tmp_path / "six.ckpt")
    assert err.lines[0] == "step 7/10, loss 6.50, inliers 0.25, 0.5 steps/s, 6 s left"


def test_steps_of_several_pairs(monkeypatch, tmp_path):
    err, clock = as_stderr(monkeypatch, terminal=False), Clock()
    run(TrainingLines(0, clock), tmp_path, clock, steps=2, pairs_a_step=3)
    steps = [line.split(", ") for line in err.lines]
    assert [line[0] for line in steps] == [f"step {n}/2" for n in (0, 0, 1, 1, 1, 2)]
    assert steps[0][-1] == "time left unknown"
    assert steps[2][-2:] == ["0.17 steps/s", "6 s left"]


def test_other_processes_say_nothing(monkeypatch):
    err, lines = as_stderr(monkeypatch, terminal=False), TrainingLines(0, Clock())
    trainer = SimpleNamespace(
        is_global_zero=False,
        global_step=0,
        max_steps=5,
        progress_bar_metrics={},
        num_val_batches=[3],
        sanity_checking=False,
    )
    lines.setup(trainer, None, "fit")
    lines.on_train_start(trainer, None)
    lines.on_train_batch_end(trainer, None, None, None, 0)
    lines.on_validation_start(trainer, None)
    lines.clock.now += 60
    lines.on_validation_batch_end(trainer, None, None, None, 0)
    assert err.lines == []
    lines.enable()
    lines.on_train_batch_end(trainer, None, None, None, 0)
    assert err.lines == ["step 0/5, time left unknown"]


def test_a_terminal_gets_a_bar(monkeypatch, tmp_path):
    err = as_stderr(monkeypatch, terminal=True)
    run(TrainingBar(), tmp_path, steps=7, validate=3)
    shown = err.getvalue()
    assert "training:" in shown
    for text in ("0/7 [", "7/7 [", "loss=6.5", "inliers=0.251", "validation:", "0/4 [", "4/4 ["):
        assert text in shown
    for text in ("0/?", "-2", "Epoch", "DataLoader", "v_num"):
        assert text not in shown


@pytest.mark.parametrize("saved_after", [4, 6])
def test_a_bar_goes_on_at_the_step_and_pace_of_the_resumed_run(monkeypatch, tmp_path, saved_after):
    """Saved amid the pairs of a run or after the last: Lightning then counts pairs from where it was, or from 0."""

    class Save(L.Callback):
        def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
            if trainer.global_step == saved_after:
                trainer.save_checkpoint(tmp_path / "last.ckpt")

    run(TrainingLines(), tmp_path, steps=6, more=[Save()])
    err, clock = as_stderr(monkeypatch, terminal=True), Clock()
    monkeypatch.setattr("tqdm.std.time", clock)
    run(TrainingBar(), tmp_path, clock, steps=10, ckpt_path=tmp_path / "last.ckpt")
    shown = [part for part in err.getvalue().split("\r") if part.startswith("training:")]
    assert f" {saved_after}/10 [" in shown[0]
    after_one = [part for part in shown if f" {saved_after + 1}/10 [" in part]
    seconds = 2 * (10 - saved_after - 1)
    assert f"[00:02<00:{seconds:02d},  0.50 steps/s, loss=" in after_one[-1]
    assert " 10/10 [" in shown[-1]


def test_a_bar_counts_steps_of_several_pairs(monkeypatch, tmp_path):
    err = as_stderr(monkeypatch, terminal=True)
    run(TrainingBar(), tmp_path, steps=2, pairs_a_step=3)
    assert " 0/2 [" in err.getvalue()
    assert " 2/2 [" in err.getvalue()
    assert "3/" not in err.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_validation_before_the_run_has_its_own_number_of_pairs(monkeypatch, tmp_path, terminal):
    err, clock = as_stderr(monkeypatch, terminal), Clock()
    display = TrainingBar() if terminal else TrainingLines(clock=clock)
    run(display, tmp_path, clock, steps=1, sanity=2)
    assert ("2/2 [" if terminal else "validation: 1/2 pairs (50 %), 3 s left") in err.getvalue()
    assert "0/?" not in err.getvalue()


def test_an_error_has_a_line_of_its_own(monkeypatch, tmp_path):
    class Fails(L.Callback):
        def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
            raise ValueError("mine")

    err = as_stderr(monkeypatch, terminal=True)
    bar = TrainingBar()
    with pytest.raises(ValueError, match="mine"):
        run(bar, tmp_path, more=[Fails()])
    assert err.getvalue().split("\r")[-2].strip() == ""
    assert err.getvalue().endswith("\r")


@pytest.mark.parametrize(("terminal", "kind"), [(True, TQDMProgressBar), (False, TrainingLines)])
def test_the_stream_decides_and_the_trainer_adds_nothing(monkeypatch, terminal, kind):
    as_stderr(monkeypatch, terminal)
    display = training_progress(seconds=3)
    assert isinstance(display, kind)
    assert terminal or display.seconds == 3
    trainer = L.Trainer(callbacks=[display], logger=False, enable_checkpointing=False, accelerator="cpu")
    assert [callback for callback in trainer.callbacks if isinstance(callback, ProgressBar)] == [display]
