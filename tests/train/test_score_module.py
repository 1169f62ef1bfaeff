from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from textured_scenes import texture
from train_run import Watch, fit, make_data, make_module

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.train.module import SipsModule


def test_validation_verifies_the_points_that_the_network_selects(tmp_path):
    module, watch = make_module(), Watch()
    fit(module, make_data(tmp_path), steps=1, callbacks=[watch])
    assert len(watch.validated) == 2
    for verified in watch.validated:
        points = SipsDetector(module.network, module.selector).detect(verified.pair.image0, 40)
        np.testing.assert_allclose(verified.features0.keypoints.xy, points.xy, atol=1e-4)
        assert verified.at(40)[1].inlier.sum() > 0


@pytest.mark.parametrize("scales", [1, 2])
def test_a_checkpoint_holds_plain_types_and_becomes_a_detector(tmp_path, scales):
    module = make_module()
    module = SipsModule(ScoreNetwork(3, 4, scales=scales), PointSelector(4, subpixel=False), module.make_optimizer)
    trainer = fit(module, make_data(tmp_path), steps=1)
    trainer.save_checkpoint(tmp_path / "a.ckpt")
    stored = torch.load(tmp_path / "a.ckpt", weights_only=True)
    assert stored["hyper_parameters"]["network"]["depth"] == 3
    detector = SipsDetector.from_checkpoint(tmp_path / "a.ckpt")
    assert detector.selector.nms_radius == 4
    assert detector.network.scales == scales
    image = texture(60, 70, 4)
    expected = SipsDetector(module.network, PointSelector(4)).detect(image, 20)
    np.testing.assert_array_equal(detector.detect(image, 20).xy, expected.xy)


def test_the_schedule_ends_with_the_run(tmp_path):
    schedule = partial(torch.optim.lr_scheduler.CosineAnnealingLR, eta_min=1e-4)
    module = make_module(scheduler=schedule)
    trainer = fit(module, make_data(tmp_path), steps=4)
    assert trainer.optimizers[0].param_groups[0]["lr"] == pytest.approx(1e-4)


def test_the_schedule_counts_optimiser_steps(tmp_path):
    schedule = partial(torch.optim.lr_scheduler.CosineAnnealingLR, eta_min=1e-4)
    module = make_module(scheduler=schedule)
    trainer = fit(module, make_data(tmp_path), steps=2, accumulate_grad_batches=2)
    assert trainer.global_step == 2
    assert trainer.optimizers[0].param_groups[0]["lr"] == pytest.approx(1e-4)


def test_a_constant_rate_needs_no_schedule(tmp_path):
    trainer = fit(make_module(), make_data(tmp_path), steps=2)
    assert trainer.optimizers[0].param_groups[0]["lr"] == 1e-2


@pytest.mark.parametrize(("step", "length"), [(0, 6), (3, 6), (4, 4)])
def test_a_loaded_checkpoint_has_the_rate_and_schedule_of_this_run(step, length):
    schedule = partial(torch.optim.lr_scheduler.CosineAnnealingLR, eta_min=1e-4)
    module = make_module(scheduler=schedule)
    module._trainer = SimpleNamespace(max_steps=length)
    stored = {"lr": 0.5, "weight_decay": 0.1, "params": [0, 1]}
    checkpoint = {
        "global_step": step,
        "optimizer_states": [{"param_groups": [stored]}],
        "lr_schedulers": [{"T_max": 3}],
    }
    module.on_load_checkpoint(checkpoint)
    expected = 1e-4 + (1e-2 - 1e-4) * (1 + np.cos(np.pi * step / length)) / 2
    assert stored["lr"] == pytest.approx(expected)
    assert (stored["weight_decay"], stored["params"]) == (0, [0, 1])
    (state,) = checkpoint["lr_schedulers"]
    assert (state["T_max"], state["last_epoch"]) == (length, step)
