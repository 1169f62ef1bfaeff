"""Tiny training runs in this process by the real configuration, and callbacks that end them early."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import lightning as L
import numpy as np
import torch
from cli_runs import TINY
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, open_dict
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sips_lit.callbacks.cards import CARDS
from sips_lit.callbacks.guard import GracefulStop
from sips_lit.cli.app import register_resolvers
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.train import train


def config_of(run: Path, frames: Path | None, *overrides: str, tiny: Sequence[str] = TINY) -> DictConfig:
    """The real configuration of a tiny run in a folder; without frames the overrides say what data."""
    register_resolvers()
    given = [] if frames is None else ["data=folder", f"data.path={frames}"]
    given += [f"paths.run={run}", f"paths.indexes={run.parent}/indexes"]
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", [*tiny, "trainer.enable_progress_bar=false", *given, *overrides])


def run_it(run: Path, frames: Path | None, *overrides: str, tiny: Sequence[str] = TINY, **callbacks: dict) -> float:
    config = config_of(run, frames, *overrides, tiny=tiny)
    with open_dict(config):
        config.callbacks.update(callbacks)
    threads = cv2.getNumThreads()
    try:
        return train(config)
    finally:
        cv2.setNumThreads(threads)


def two_kinds(root: Path, frames: Path) -> list[str]:
    """Overrides for a mixture of two sources: frames, and the same ones under noise, with hardly any inliers."""
    (root / "tum_fr1_xyz").mkdir(parents=True)
    (root / "boofcv_driving_snow").symlink_to(frames)
    rng = np.random.default_rng(0)
    for file in sorted(frames.iterdir()):
        clean = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        noisy = np.clip(clean + rng.normal(0, 25, clean.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(root / "tum_fr1_xyz" / file.name), noisy)
    others = ("boards", "outdoors", "drives", "desk", "city", "flights", "drone")
    return ["data=released", f"+root={root}", *(f"data.sources.{name}=null" for name in others)]


def weights(run: Path, name: str = "last") -> dict[str, torch.Tensor]:
    return torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True)["state_dict"]


def assert_equal_weights(a: Path, b: Path, name: str = "last") -> None:
    one, other = weights(a, name), weights(b, name)
    assert one.keys() == other.keys()
    for name in one:
        assert torch.equal(one[name], other[name]), name


def scalars(run: Path) -> dict[str, list[tuple[int, float]]]:
    """What TensorBoard has of a run, (step, value) by the name that was logged."""
    events = EventAccumulator(str(run)).Reload()
    return {logged_name(tag): [(e.step, e.value) for e in events.Scalars(tag)] for tag in events.Tags()["scalars"]}


def logged_name(tag: str) -> str:
    """The name whose card has a tag."""
    (found,) = (
        (name, card)
        for name, card in CARDS.items()
        if tag == card.tag or (tag.startswith(card.tag) and name[-1] in "/-_")
    )
    return found[0] + tag.removeprefix(found[1].tag)


class StopAt(L.Callback):
    """Asks for a graceful stop after a step, as Ctrl-C would."""

    def __init__(self, step: int) -> None:
        self.step = step

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        if trainer.global_step == self.step - 1:
            (stop,) = (c for c in trainer.callbacks if isinstance(c, GracefulStop))
            stop.requested = True


class CrashAt(L.Callback):
    """Fails like a machine: nothing is saved."""

    def __init__(self, step: int) -> None:
        self.step = step

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        if trainer.global_step == self.step:
            raise RuntimeError("power cut")


def target(kind: type, **arguments) -> dict:
    return {"_target_": f"{kind.__module__}.{kind.__name__}", **arguments}


def one_cycle(optimizer, T_max):
    """A schedule that moves the optimiser's momentum, too."""
    return torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=0.01, total_steps=T_max + 1)


def polynomial(optimizer, T_max):
    """A schedule whose length has another name."""
    return torch.optim.lr_scheduler.PolynomialLR(optimizer, T_max, power=2)
