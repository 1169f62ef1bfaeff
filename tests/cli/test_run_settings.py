from types import SimpleNamespace

import pytest
from cli_runs import TINY
from tiny_runs import config_of

from sips_lit.cli.run_settings import settings_of


def source(name: str, *sequences: str):
    return SimpleNamespace(name=name, sequences=[SimpleNamespace(name=sequence) for sequence in sequences])


ONE = source("data", "street")


def settings(tmp_path, *overrides, sources=(ONE,)):
    return settings_of(config_of(tmp_path / "run", tmp_path, *overrides), SimpleNamespace(sources=sources))


def test_data_labels_loss_and_model_come_first(tmp_path):
    told = settings(tmp_path, "module.ranking=5", "inliers=homography")
    assert sorted(told)[:4] == ["data", "inliers", "loss", "model"]
    assert told["data"] == "street"
    assert told["inliers"] == "HomographyInliers"
    assert told["loss"] == "consistency 0.3, consistency_beta 0.5, ranking 5"
    assert told["model"] == "depth 3, width 4"


def test_every_setting_has_a_column_of_its_own(tmp_path):
    told = settings(tmp_path, "seed=7", "datamodule.budgets=[50,100]", "augment.blur=0.5", "descriptor=orb")
    assert (told["seed"], told["pairs.budgets"], told["training.augment.blur"]) == (7, "[50, 100]", 0.5)
    assert (told["pairs.descriptor"], told["pairs.inliers.tracker.window"]) == ("OrbDescriptor", 15)
    assert (told["module.points"], told["model.depth"], told["optim.optimizer.lr"]) == (40, 3, 1e-3)
    assert told["optim.init"] == "None"
    assert (told["validation.k"], told["validation.overlap"], told["validation.pairs"]) == (10, 0.1, 2)
    assert all(isinstance(value, int | float | str) for value in told.values())
    assert not any("_target_" in name or "selector" in name for name in told)


@pytest.mark.parametrize(
    ("sources", "told"),
    [
        ([source("data", "a", "b")], "a, b"),
        ([source("data", *"abcde")], "a, b, c and 2 more"),
        ([source("city", "a", "b"), source("flights", "c")], "city, flights"),
    ],
)
def test_data_by_name(tmp_path, sources, told):
    assert settings(tmp_path, sources=sources)["data"] == told


def test_a_distillation(tmp_path):
    tiny = [override for override in TINY if "labelling" not in override]
    config = config_of(tmp_path / "run", tmp_path, "experiment=distill", "teacher=x", tiny=tiny)
    told = settings_of(config, SimpleNamespace(sources=[ONE]))
    assert told["loss"] == "emphasis 20, logit_weight 0.1, bound 8"
    assert told["pairs.between"] == "None"
