import json
from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest
import torch
from textured_scenes import texture
from train_run import fit, make_data, make_module

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.train import module as module_file
from sips_lit.train.gradient_route import RememberedCosts, RouteCosts, measured_costs, setting

NETWORK = ScoreNetwork(3, 8)
IMAGES = [image_tensor(texture(40, 50)), image_tensor(texture(30, 60, 1))]  # 2000 and 1800 pixels
POINTS = [PointSelector().anywhere.select(NETWORK, image, count) for image, count in zip(IMAGES, (12, 7), strict=True)]
CPU = torch.device("cpu")


@pytest.mark.parametrize(("point", "route"), [(199e-9, "patches"), (201e-9, "dense")])
def test_the_route_that_costs_less_for_all_images_is_taken(point, route):
    assert sum(map(len, POINTS)) == 19
    assert RouteCosts(pixel=1e-9, point=point).faster(IMAGES, POINTS) == route  # 3800 pixels, 19 points


def test_costs_are_the_least_of_the_turns_by_pixel_and_by_point():
    dense, patches = [900.0, 40.0, 38.0, 41.0], [900.0, 20.0, 21.0, 19.0]
    gaps = [gap for turn in zip(patches, dense, strict=True) for gap in (1.0, turn[0], 1.0, turn[1])]
    ticks = iter(accumulate(gaps))
    costs = measured_costs(NETWORK, IMAGES, POINTS, clock=lambda: next(ticks))
    assert costs.pixel == pytest.approx(38 / 3800)
    assert costs.point == pytest.approx(19 / 19)
    assert next(ticks, None) is None, "as many turns as there are times"
    assert "fewer than 100 pixels a point" in str(costs)


def test_measuring_leaves_no_gradient():
    measured = measured_costs(NETWORK, IMAGES, POINTS)
    assert measured.pixel > 0
    assert measured.point > 0
    assert all(weights.grad is None for weights in NETWORK.parameters())


def test_costs_hold_for_a_network_and_a_machine():
    own = setting(NETWORK, CPU, "32-true", compiled=False)
    assert setting(ScoreNetwork(3, 8, octaves=2, corners=0.75, start_bias=0), CPU, "32-true", False) == own
    others = {
        setting(ScoreNetwork(3, 16), CPU, "32-true", False),
        setting(ScoreNetwork(4, 8), CPU, "32-true", False),
        setting(ScoreNetwork(3, 8, derivatives=True), CPU, "32-true", False),
        setting(NETWORK, CPU, "bf16-mixed", False),
        setting(NETWORK, CPU, "32-true", True),
        own,
    }
    threads = torch.get_num_threads()
    torch.set_num_threads(threads + 1)
    try:
        others.add(setting(NETWORK, CPU, "32-true", False))
    finally:
        torch.set_num_threads(threads)
    assert len(others) == 7


def test_costs_are_remembered_by_setting(tmp_path):
    path = tmp_path / "new" / "costs.json"
    RememberedCosts(path).put("a", RouteCosts(1e-6, 2e-3))
    RememberedCosts(path).put("b", RouteCosts(3e-6, 4e-3))
    RememberedCosts(path).put("a", RouteCosts(5e-6, 6e-3))
    assert RememberedCosts(path).get("a") == RouteCosts(5e-6, 6e-3)
    assert RememberedCosts(path).get("b") == RouteCosts(3e-6, 4e-3)
    assert RememberedCosts(path).get("c") is None
    nowhere = RememberedCosts(None)
    nowhere.put("a", RouteCosts(1, 1))
    assert nowhere.get("a") is None


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[1]", b"\xff", b'{"a": 1}', b'{"a": {"pixel": 1}}', b'{"a": {"pixel": "1", "point": 1}}']
    + [f'{{"a": {{"pixel": {bad}, "point": 1}}}}'.encode() for bad in ("0", "-1", "NaN", "Infinity", "null")],
)
def test_a_damaged_file_is_told_of_and_replaced(tmp_path, content):
    path = tmp_path / "costs.json"
    path.write_bytes(content)
    with pytest.warns(InputWarning, match=r"costs\.json is damaged"):
        assert RememberedCosts(path).get("a") is None
    with pytest.warns(InputWarning, match="damaged"):
        RememberedCosts(path).put("b", RouteCosts(1e-6, 2e-3))
    assert list(json.loads(path.read_text())) == ["b"]


def run(path):
    """The module after two steps with ``gradient=auto``."""
    module = make_module(gradient="auto", gradient_costs=path)
    fit(module, make_data(path.parent))
    return module


def test_a_training_measures_once_and_the_next_one_remembers(tmp_path, monkeypatch, capsys):
    path = tmp_path / "costs.json"
    run(path)
    assert "ms a point by its receptive field" in capsys.readouterr().out
    (costs,) = json.loads(path.read_text()).values()
    monkeypatch.delattr(module_file, "measured_costs")
    again = run(path)
    assert [(of.pixel, of.point) for of in again._costs.values()] == [(costs["pixel"], costs["point"])]


@pytest.mark.parametrize(("point", "passes"), [(1e-9, "fields"), (1e9, "whole")])
def test_what_was_measured_decides(tmp_path, point, passes):
    module = make_module(gradient="auto", gradient_costs=tmp_path / "costs.json")
    of = setting(module.network, CPU, "32-true", compiled=False)
    RememberedCosts(tmp_path / "costs.json").put(of, RouteCosts(1.0, point))
    seen = []
    module.network.layers[-1].register_forward_hook(
        lambda _, __, out: seen.append("whole" if min(out.shape[-2:]) > 1 else "fields") if out.requires_grad else None
    )
    fit(module, make_data(tmp_path))
    assert set(seen) == {passes}


def test_a_run_goes_on_by_the_costs_that_it_went_by(tmp_path):
    module = run(tmp_path / "costs.json")
    checkpoint = {}
    module.on_save_checkpoint(checkpoint)
    other = make_module(gradient="auto")
    state = {"global_step": 2, "optimizer_states": [{"param_groups": [{}]}], **checkpoint}
    other.on_load_checkpoint(state)
    assert other._costs == module._costs


def test_images_without_points_measure_nothing(tmp_path):
    module = make_module(gradient="auto", gradient_costs=tmp_path / "costs.json")
    module._trainer = type("Trainer", (), {"precision": "32-true"})()
    none = [
        replace(p, keypoints=p.keypoints[:0], level=p.level[:0], row=p.row[:0], column=p.column[:0]) for p in POINTS
    ]
    assert module._route(IMAGES, none) == "patches"
    assert not (tmp_path / "costs.json").exists()


@pytest.mark.parametrize("name", ["Dense", "sparse", "", None, np.nan])
def test_another_gradient_is_refused(name):
    with pytest.raises(BadInputError, match="give patches, dense or auto"):
        make_module(gradient=name)
