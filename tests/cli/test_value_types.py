import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from sips_lit.cli.app import build, register_resolvers
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.value_types import refuse_wrong_types
from sips_lit.errors import BadInputError


def training(*overrides: str):
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", ["data=video", "data.path=a.mp4", "paths.data=x", "paths.run=x", *overrides])


@pytest.mark.parametrize(
    ("part", "override", "sentence"),
    [
        ("datamodule", "datamodule.between=1.5", "datamodule.between is 1.5: give a whole number"),
        ("datamodule", "datamodule.between=x", "datamodule.between is x: give a whole number"),
        ("datamodule", "datamodule.val_pairs=true", "datamodule.val_pairs is True: give a whole number"),
        ("datamodule", "datamodule.spread=x", "datamodule.spread is x: give a number"),
        ("datamodule", "datamodule.overlap=null", "datamodule.overlap is None: give a number"),
        (
            "datamodule",
            "datamodule.budgets=[25,1.5]",
            "datamodule.budgets is [25, 1.5]: give a list, each item a whole number",
        ),
        ("datamodule", "datamodule.budgets=25", "datamodule.budgets is 25: give a list, each item a whole number"),
        ("datamodule", "seed=x", "seed is x: give a whole number"),
        ("datamodule", "augment.flip=often", "augment.flip is often: give a number"),
        ("datamodule", "inliers.threshold=x", "inliers.threshold is x: give a number"),
        ("datamodule", "data.max_side=640.5", "data.max_side is 640.5: give a whole number, or null"),
        ("module", "model.derivatives=maybe", "model.derivatives is maybe: give true or false"),
        ("module", "model.derivatives=1", "model.derivatives is 1: give true or false"),
        ("module", "module.selector.nms_radius=5.5", "module.selector.nms_radius is 5.5: give a whole number"),
        ("module", "module.ranking=x", "module.ranking is x: give a number"),
    ],
)
def test_the_key_and_what_it_takes_are_told(part, override, sentence):
    with pytest.raises(BadInputError) as told:
        build(training(override)[part])
    assert str(told.value) == sentence


@pytest.mark.parametrize("override", ["datamodule.overlap=1", "datamodule.budgets=[]", "data.max_side=null", "seed=3"])
def test_a_whole_number_is_a_number_and_null_is_taken_where_it_may_be(override):
    refuse_wrong_types(training(override).datamodule)


def test_what_is_not_ours_or_not_there_is_left_to_hydra():
    refuse_wrong_types(OmegaConf.create({"_target_": "lightning.Trainer", "max_steps": "x"}))
    refuse_wrong_types(OmegaConf.create({"_target_": "sips_lit.nowhere.Nothing", "n": "x"}))
    refuse_wrong_types(OmegaConf.create({"a": [{"_target_": "sips_lit.detect.selection.PointSelector"}], "b": None}))


def test_lists_of_parts_are_looked_through():
    wrong = OmegaConf.create({"a": [{"_target_": "sips_lit.detect.selection.PointSelector", "nms_radius": "x"}]})
    with pytest.raises(BadInputError, match=r"^a\[0\]\.nms_radius is x: give a whole number$"):
        refuse_wrong_types(wrong)
