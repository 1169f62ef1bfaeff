"""What a user sees of sips-train experiment=distill and init=FILE."""

import re
from pathlib import Path

import pytest
import torch
from cli_runs import TINY
from tiny_network import tiny_network
from tiny_runs import StopAt, assert_equal_weights, run_it, target

from sips_lit.detect.checkpoint import export_safetensors
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError, TrainingInterrupted

DISTILL = [
    *[argument for argument in TINY if "labelling_workers" not in argument],
    "experiment=distill",
    "model.derivatives=false",
    "datamodule.crops=2",
    "datamodule.size=48",
]
STEPS = "trainer.max_steps=6", "trainer.val_check_interval=3", "~callbacks.pictures"


def given(frames, *more: str, base=TINY) -> list[str]:
    return [*base, "data=folder", f"data.path={frames}", *more]


@pytest.fixture(scope="module")
def trained(tmp_path_factory, frames) -> Path:
    """The run folder of a short sparse training."""
    run = tmp_path_factory.mktemp("trained") / "run"
    run_it(run, frames, *STEPS)
    return run


def test_a_student_is_trained_exported_and_fine_tuned(command, checkpoint, frames, folders):
    run = folders / "outputs" / "student"
    distilled = command("train", *given(frames, f"teacher={checkpoint}", *STEPS, f"hydra.run.dir={run}", base=DISTILL))
    assert distilled.code == 0, distilled.err
    assert "best validation AUC" in distilled.out
    assert "excess_loss" in distilled.err
    best = run / "checkpoints" / "best.ckpt"
    assert command("export", f"checkpoint={best}").code == 0
    tuned = command("train", *given(frames, f"init={best}", *STEPS))
    assert tuned.code != 0
    assert "is another network, with derivatives" in tuned.err  # TINY is `small` with derivatives
    tuned = command("train", *given(frames, f"init={best}", "model.derivatives=false", *STEPS))
    assert tuned.code == 0, tuned.err
    assert re.search(r"fine-tuning: (AUC|no gain: AUC) 0\.\d{3} with the weights of .*best\.ckpt, 0\.\d{3} ", tuned.out)


def test_an_interrupted_distillation_goes_on_exactly(checkpoint, tmp_path, frames):
    overrides = [f"teacher={checkpoint}", *STEPS]
    auc = distil(tmp_path / "whole", frames, *overrides)
    with pytest.raises(TrainingInterrupted):
        distil(tmp_path / "run", frames, *overrides, halt=target(StopAt, step=4))
    again = distil(tmp_path / "again", frames, *overrides, f"ckpt_path={tmp_path}/run/checkpoints/last.ckpt")
    assert again == auc
    for name in ("last", "best"):
        assert_equal_weights(tmp_path / "again", tmp_path / "whole", name)
    other = tmp_path / "other.safetensors"
    export_safetensors(tiny_network(3), PointSelector(), other)
    last = f"ckpt_path={tmp_path}/run/checkpoints/last.ckpt"
    with pytest.raises(BadInputError, match="of another run, with weights of teacher="):
        distil(tmp_path / "again", frames, *overrides, f"teacher={other}", last)


def distil(run: Path, frames: Path, *overrides: str, **callbacks: dict) -> float:
    return run_it(run, frames, *overrides, tiny=DISTILL, **callbacks)


def test_the_teacher_must_be_a_network(command, frames, tmp_path):
    assert command("train", *given(frames, base=DISTILL)).sentence.startswith("teacher is not set: add teacher=...")
    gone = command("train", *given(frames, f"teacher={tmp_path}/gone.ckpt", base=DISTILL))
    assert f"there is no checkpoint {tmp_path}/gone.ckpt" in gone.sentence
    several = command("train", *given(frames, "teacher=[a.ckpt,b.ckpt]", base=DISTILL))
    assert several.sentence == "teacher is ['a.ckpt', 'b.ckpt']: give a path"
    (tmp_path / "bad.ckpt").write_bytes(b"no checkpoint")
    bad = command("train", *given(frames, f"teacher={tmp_path}/bad.ckpt", base=DISTILL))
    assert "bad.ckpt can't be read as a checkpoint" in bad.sentence
    network = tiny_network()
    with torch.no_grad():
        network.layers[0].weight[0] = float("nan")
    export_safetensors(network, PointSelector(), tmp_path / "nan.safetensors")
    for key, base in (("teacher", DISTILL), ("init", TINY)):
        result = command("train", *given(frames, f"{key}={tmp_path}/nan.safetensors", base=base))
        assert "nan.safetensors holds weights that are not finite" in result.sentence


def test_a_start_of_another_size_is_refused(command, frames, trained):
    sentence = command("train", *given(frames, f"init={trained}/checkpoints/best.ckpt", "model.width=6")).sentence
    assert "best.ckpt is another network, with width=4 (here 6): give the same model" in sentence


def test_a_fine_tuning_starts_from_the_weights_and_knows_their_score(trained, tmp_path, frames, capsys):
    init = f"init={trained}/checkpoints/best.ckpt"
    still = "optim.optimizer.lr=0", "optim.scheduler=null", "module.points=40"
    run_it(tmp_path / "still", frames, init, *STEPS, *still)
    assert_equal_weights(tmp_path / "still", trained, "best")
    told = capsys.readouterr().out
    score = re.search(r"best validation AUC (\d\.\d{3})", told)[1]
    assert f"no gain: AUC {score} with the weights of {trained}/checkpoints/best.ckpt, {score} at best after it" in told


def test_a_fine_tuning_goes_on_and_remembers_its_start(trained, tmp_path, frames, capsys):
    init = f"init={trained}/checkpoints/best.ckpt"
    auc = run_it(tmp_path / "whole", frames, init, *STEPS)
    told = re.search("fine-tuning: .*", capsys.readouterr().out)[0]
    with pytest.raises(TrainingInterrupted):
        run_it(tmp_path / "run", frames, init, *STEPS, halt=target(StopAt, step=2))
    last = f"ckpt_path={tmp_path}/run/checkpoints/last.ckpt"
    assert run_it(tmp_path / "again", frames, init, *STEPS, last) == auc
    assert re.search("fine-tuning: .*", capsys.readouterr().out)[0] == told
    assert_equal_weights(tmp_path / "again", tmp_path / "whole")
    with pytest.raises(BadInputError, match="of another run, with weights of init="):
        run_it(tmp_path / "none", frames, *STEPS, last)
