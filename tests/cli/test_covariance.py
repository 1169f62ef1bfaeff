"""What a user sees of covariances: sips-train experiment=covariance, sips-detect, sips-evaluate, sips-calibrate."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from cli_runs import TINY

from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork


@pytest.fixture
def headed(checkpoint, tmp_path) -> Path:
    """The untrained network of ``checkpoint`` with an untrained covariance head."""
    network, selector = load_checkpoint(checkpoint)
    with_head, path = ScoreNetwork(**network.config | {"covariance": True}), tmp_path / "headed.safetensors"
    with_head.load_state_dict(network.state_dict(), strict=False)
    export_safetensors(with_head, selector, path)
    return path


def test_a_head_is_trained_on_frozen_weights_and_used(command, checkpoint, frames, folders):
    run = folders / "run"
    given = ["data=folder", f"data.path={frames}", f"init={checkpoint}", "model.derivatives=false"]
    steps = ["trainer.max_steps=3", "trainer.val_check_interval=3", "callbacks.pictures=null", f"hydra.run.dir={run}"]
    trained = command("train", *TINY, "experiment=covariance", *given, *steps)
    assert trained.code == 0, trained.err
    assert re.search(r"covariance:  error of its reliability 0\.\d{3}, needed factor \d+\.\d\d", trained.out)
    assert "fine-tuning" not in trained.out
    best = run / "checkpoints" / "best.ckpt"
    (before, _), (after, _) = load_checkpoint(checkpoint), load_checkpoint(best)
    for name, weight in before.state_dict().items():
        assert torch.equal(weight, after.state_dict()[name])
    assert after.covariance_head.bias.any()

    image = frames / "003.png"
    found = command("detect", f"checkpoint={best}", f"input={image}", "n=20", "format=npz", f"output={folders}/points")
    assert found.code == 0, found.err
    stored = np.load(folders / "points" / "003.npz")["covariances"]
    np.testing.assert_array_equal(stored, SipsDetector.from_checkpoint(best)(image, 20).covariance)


def test_a_head_is_not_trained_with_scores(command, frames):
    refused = command("train", *TINY, "data=folder", f"data.path={frames}", "model.covariance=true")
    assert "experiment=covariance" in refused.sentence


@pytest.mark.draws
def test_an_evaluation_tells_their_reliability(command, frames, folders, headed):
    given = "data=folder", f"data.path={frames}", "pairs=4", "k=4", "n_max=40", "n=30", "calibration=[30]", "workers=1"
    result = command("evaluate", f"checkpoint={headed}", *given, "pictures=false", f"hydra.run.dir={folders}/report")
    assert result.code == 0, result.err
    assert "covariance error at 30" in result.out
    assert "needed factor at 30" in result.out
    (figure,) = (folders / "report" / "figures").glob("*_covariance_30.png")
    assert figure.stat().st_size > 1000


def test_calibration_gives_covariances_the_factor_that_residuals_ask_for(command, frames, folders, headed):
    def calibrate(checkpoint: Path, output: Path) -> float:
        given = "data=folder", f"data.path={frames}", "pairs=6", "k=4", "n_max=40", "calibration=[10,30]", "workers=1"
        result = command(
            "calibrate", f"checkpoint={checkpoint}", f"output={output}", *given, f"hydra.run.dir={folders}/r"
        )
        assert result.code == 0, result.err
        return float(re.search(r"covariances are multiplied by (\d+\.\d+)", result.out)[1])

    once, twice = folders / "once.safetensors", folders / "twice.safetensors"
    factor = calibrate(headed, once)
    image = frames / "003.png"
    before, after = (SipsDetector.from_checkpoint(file)(image, 20).covariance for file in (headed, once))
    np.testing.assert_allclose(after, before * factor, rtol=0.02 / factor + 0.01)
    assert calibrate(once, twice) == pytest.approx(1, abs=0.011)


def test_export_keeps_the_head(command, folders, headed):
    output = folders / "again.safetensors"
    assert command("export", f"checkpoint={headed}", f"output={output}").code == 0
    assert load_checkpoint(output)[0].covariance_head is not None
