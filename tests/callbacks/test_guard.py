import os
import signal
from types import SimpleNamespace

import lightning as L
import numpy as np
import pytest
import torch

from sips_lit.callbacks.guard import GracefulStop, LastValidation, NonFiniteGuard
from sips_lit.detect.selection import SelectedPoints
from sips_lit.errors import BadInputError, TrainingInterrupted
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.matching.mutual_nearest import MutualLifetimes
from sips_lit.train.loader import LabelledPair
from sips_lit.types import Keypoints

NO_MATCHES = MutualLifetimes(*[np.zeros(0, np.int64)] * 4)


class Trainer(SimpleNamespace):
    """What the callbacks ask of a trainer; remembers what it saved."""

    def __init__(self, **options) -> None:
        defaults = {"global_step": 7, "accumulate_grad_batches": 1, "should_stop": False}
        one = {"world_size": 1, "is_global_zero": True, "sanity_checking": False}
        lightning = {"_signal_connector": SimpleNamespace(), "strategy": SimpleNamespace(launcher=None)}
        super().__init__(**{**defaults, **one, **lightning, "val_check_batch": 10, "saved": [], **options})

    def save_checkpoint(self, path) -> None:
        self.saved.append(path)


def labelled(n: int) -> LabelledPair:
    places = np.arange(n)
    points = SelectedPoints(
        Keypoints(np.ones((n, 2), np.float32), np.linspace(1, 0, n, dtype=np.float32), np.ones(n, np.float32)),
        np.zeros(n, np.int64),
        places,
        places + 1,
    )
    labels = PointLabels(np.ones(n, bool), np.ones(n, bool), np.zeros(n, np.uint8), np.ones(n, np.float32))
    image = torch.full((1, 1, 6, 8), 5.0)
    return LabelledPair(image, image + 1, points, points, labels, labels, NO_MATCHES, 0, "city:3-9")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("n", [4, 0])
def test_a_loss_that_is_not_finite_saves_its_batch(tmp_path, value, n):
    guard = NonFiniteGuard(tmp_path / "new")
    guard.on_train_batch_start(Trainer(), None, labelled(n), 0)
    with pytest.raises(BadInputError, match=r"loss became -?(nan|inf) at step 7: .*nonfinite_batch\.pt; lower optim"):
        guard.on_before_backward(Trainer(), None, torch.tensor(value, requires_grad=True))
    batch = torch.load(tmp_path / "new" / "nonfinite_batch.pt", weights_only=True)
    assert batch["name"] == "city:3-9"
    assert torch.equal(batch["image1"], torch.full((1, 1, 6, 8), 6.0))
    assert torch.equal(batch["column1"], torch.arange(n) + 1)
    assert batch["xy0"].shape == (n, 2)
    for name in ("score", "scale", "row", "inlier", "known", "reason"):
        assert batch[f"{name}0"].shape == batch[f"{name}1"].shape == (n,)


def test_a_finite_loss_passes(tmp_path):
    guard = NonFiniteGuard(tmp_path)
    guard.on_train_batch_start(Trainer(), None, labelled(2), 0)
    guard.on_before_backward(Trainer(), None, torch.tensor(1e30))
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def stop(tmp_path):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    callback = GracefulStop(tmp_path / "last.ckpt")
    callback.on_fit_start(Trainer(), None)
    yield callback
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


def batch_end(stop, trainer, batch_idx):
    stop.on_train_batch_end(trainer, None, None, None, batch_idx)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_step_then_saves_and_stops(stop, tmp_path, number):
    trainer = Trainer()
    batch_end(stop, trainer, 5)
    os.kill(os.getpid(), number)
    with pytest.raises(TrainingInterrupted, match=r"stopped at step 7 and saved .*last\.ckpt$") as caught:
        batch_end(stop, trainer, 6)
    assert caught.value.number == number
    assert trainer.saved == [tmp_path / "last.ckpt"]


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_after_a_signal_stops_at_once(stop, first):
    os.kill(os.getpid(), first)
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_scheduler_that_tells_twice_gets_its_checkpoint(stop):
    for _ in range(3):
        os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(TrainingInterrupted):
        batch_end(stop, Trainer(), 6)


def test_a_step_of_several_pairs_is_finished(stop):
    trainer = Trainer(accumulate_grad_batches=3)
    stop.requested = signal.SIGTERM
    batch_end(stop, trainer, 3)
    batch_end(stop, trainer, 4)
    assert trainer.saved == []
    with pytest.raises(TrainingInterrupted):
        batch_end(stop, trainer, 5)


def test_a_validation_that_is_due_comes_first(stop):
    trainer = Trainer()
    stop.requested = signal.SIGTERM
    batch_end(stop, trainer, 9)
    assert trainer.saved == []
    with pytest.raises(TrainingInterrupted):
        stop.on_validation_end(trainer, None)
    assert len(trainer.saved) == 1


def test_a_sanity_check_has_nothing_to_save(stop):
    trainer = Trainer(sanity_checking=True)
    stop.requested = signal.SIGTERM
    stop.on_validation_end(trainer, None)
    assert trainer.saved == []


@pytest.mark.parametrize(("here", "there", "number"), [(0, 15, 15), (2, 0, 2), (2, 15, 15), (0, 0, 0)])
def test_of_several_processes_any_may_get_the_signal(stop, here, there, number):
    def highest(asked: torch.Tensor, reduce_op: str) -> torch.Tensor:
        assert reduce_op == "max"
        return torch.maximum(asked, torch.tensor(there))

    strategy = SimpleNamespace(launcher=None, root_device="cpu", reduce=highest)
    first, second = (Trainer(world_size=2, strategy=strategy, is_global_zero=zero) for zero in (True, False))
    stop.requested = here
    if number == 0:
        batch_end(stop, first, 6)
        assert first.saved == []
        return
    with pytest.raises(TrainingInterrupted) as told:
        batch_end(stop, first, 6)
    assert told.value.number == number
    with pytest.raises(SystemExit) as silent:
        batch_end(stop, second, 6)
    assert silent.value.code == 0
    assert len(first.saved) == len(second.saved) == 1  # all take part in saving


def test_an_error_ends_the_processes_that_wait_for_this_one(stop):
    import subprocess
    import sys

    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    processes = [child]
    stop.on_exception(Trainer(strategy=SimpleNamespace(launcher=SimpleNamespace(procs=processes))), None, OSError())
    assert child.wait(10) == -signal.SIGKILL
    assert processes == []  # nobody watches them any more


@pytest.fixture
def warned(tmp_path):
    """A stop in whose process somebody listens to SIGUSR2, and what it heard."""
    names = "SIGINT", "SIGTERM", "SIGUSR1", "SIGUSR2"
    before = {name: signal.getsignal(getattr(signal, name)) for name in names}
    heard = []
    signal.signal(signal.SIGUSR2, lambda number, frame: heard.append((number, frame)))
    callback = GracefulStop(tmp_path / "last.ckpt")
    callback.on_fit_start(Trainer(), None)
    yield callback, heard
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


def test_who_listens_to_a_warning_hears_of_it_when_the_checkpoint_is_there(warned):
    callback, heard = warned
    trainer = Trainer(accumulate_grad_batches=2)
    os.kill(os.getpid(), signal.SIGUSR2)
    batch_end(callback, trainer, 6)
    assert trainer.saved == heard == []  # in the middle of a step
    with pytest.raises(TrainingInterrupted, match=r"saved .*last\.ckpt$") as caught:
        batch_end(callback, trainer, 7)
    assert caught.value.number == signal.SIGUSR2
    assert len(trainer.saved) == 1
    assert heard == [(signal.SIGUSR2, None)]


def test_a_warning_to_which_nobody_listens_is_not_touched(stop):
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL
    assert signal.getsignal(signal.SIGUSR2) is signal.SIG_DFL


def test_a_listener_that_ends_the_process_does_so_after_the_checkpoint(warned):
    callback, _ = warned

    def leave(*_):
        raise SystemExit(-1)  # as submitit's does

    callback._previous[signal.SIGUSR2] = leave
    callback.requested = signal.SIGUSR2
    trainer = Trainer()
    with pytest.raises(SystemExit) as caught:
        batch_end(callback, trainer, 6)
    assert caught.value.code == -1
    assert len(trainer.saved) == 1
    before = signal.getsignal(signal.SIGTERM)
    callback.on_exception(trainer, None, caught.value)
    assert signal.getsignal(signal.SIGTERM) == before  # the scheduler's comes next, and must not disturb


@pytest.mark.parametrize("first", [True, False])
def test_in_a_job_of_slurm_a_warning_asks_for_another_start(tmp_path, monkeypatch, warned, first):
    asked = []
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    monkeypatch.setattr("sips_lit.callbacks.guard.requeue", lambda: asked.append(1) or "Slurm starts job 7 again")
    strategy = SimpleNamespace(launcher=None, root_device="cpu", reduce=lambda number, reduce_op: number)
    trainer = Trainer(world_size=2, strategy=strategy, is_global_zero=first)
    callback = GracefulStop(tmp_path / "last.ckpt")
    callback.on_fit_start(trainer, None)
    os.kill(os.getpid(), signal.SIGUSR1)
    with pytest.raises(TrainingInterrupted if first else SystemExit) as caught:
        batch_end(callback, trainer, 6)
    assert len(trainer.saved) == 1
    assert asked == [1] * first  # one process for all
    if first:
        assert str(caught.value).endswith("last.ckpt; Slurm starts job 7 again")


def test_a_warning_after_the_training_does_not_end_its_report(tmp_path, monkeypatch, warned):
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    callback = GracefulStop(tmp_path / "last.ckpt")
    callback.on_fit_start(Trainer(), None)
    os.kill(os.getpid(), signal.SIGUSR1)
    callback.teardown(Trainer(), None, "fit")  # by itself the signal would end this process
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL


def test_nobody_asked_to_stop(stop):
    trainer = Trainer()
    for batch in range(20):
        stop.on_train_batch_start(trainer, None, None, batch)
        batch_end(stop, trainer, batch)
    stop.on_validation_end(trainer, None)
    assert trainer.saved == []


@pytest.mark.parametrize("how", ["teardown", "on_exception"])
def test_the_signals_are_given_back(stop, how):
    ours = signal.getsignal(signal.SIGINT)
    if how == "teardown":
        stop.teardown(Trainer(), None, "fit")
    else:
        stop.on_exception(Trainer(), None, RuntimeError())
    assert signal.getsignal(signal.SIGINT) != ours
    handler = signal.getsignal(signal.SIGINT)
    stop.teardown(Trainer(), None, "fit")
    assert signal.getsignal(signal.SIGINT) == handler


def test_a_stop_is_not_disturbed_by_another_sigterm(stop):
    stop.requested = signal.SIGTERM
    stop.on_exception(Trainer(), None, TrainingInterrupted("stopped", signal.SIGTERM))
    os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_came_too_late_is_passed_on(stop, number):
    passed = []
    stop._previous[number] = lambda number, frame: passed.append(number)
    os.kill(os.getpid(), number)
    stop.teardown(Trainer(), None, "fit")
    assert passed == [number]


def test_a_new_fit_forgets_an_old_request(stop):
    stop.requested = signal.SIGTERM
    stop.on_fit_start(Trainer(), None)
    trainer = Trainer()
    batch_end(stop, trainer, 0)
    assert trainer.saved == []


@pytest.mark.parametrize(("step", "stops"), [(3, False), (4, True)])
def test_the_last_step_asks_for_a_validation(step, stops):
    trainer = SimpleNamespace(global_step=step, max_steps=4, should_stop=False)
    LastValidation().on_train_batch_end(trainer, None, None, None, step - 1)
    assert trainer.should_stop is stops


class Counting(L.LightningModule):
    """Notes after how many steps it is validated."""

    def __init__(self):
        super().__init__()
        self.layer, self.validated = torch.nn.Linear(1, 1), []

    def training_step(self, batch, batch_idx):
        return self.layer(batch).sum()

    def validation_step(self, batch, batch_idx):
        if not self.trainer.sanity_checking:
            self.validated.append(self.global_step)

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 0.1)


@pytest.mark.parametrize(("callbacks", "validated"), [([], [3, 6]), ([LastValidation()], [3, 6, 7])])
def test_a_trainer_validates_after_its_last_step(callbacks, validated, tmp_path):
    batches = torch.utils.data.DataLoader(torch.ones(20, 1))
    trainer = L.Trainer(
        max_steps=7, val_check_interval=3, callbacks=callbacks, accelerator="cpu", logger=False,
        enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False, default_root_dir=tmp_path,
    )  # fmt: skip
    module = Counting()
    trainer.fit(module, batches, torch.utils.data.DataLoader(torch.ones(1, 1)))
    assert module.validated == validated
