import pytest
from cli_runs import TINY
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
        ("datamodule", "augment.blur=inf", "augment.blur is inf: give a number"),
        ("datamodule", "augment.log2_zoom=1e400", "augment.log2_zoom is inf: give a number"),
        ("module", "model.leaky_slope=nan", "model.leaky_slope is nan: give a number"),
        ("datamodule", "augment.flip=often", "augment.flip is often: give a number"),
        ("datamodule", "inliers.threshold=x", "inliers.threshold is x: give a number"),
        ("datamodule", "data.max_side=640.5", "data.max_side is 640.5: give a whole number, or null"),
        ("module", "model.derivatives=maybe", "model.derivatives is maybe: give true or false"),
        ("module", "model.derivatives=1", "model.derivatives is 1: give true or false"),
        ("module", "module.selector.nms_radius=5.5", "module.selector.nms_radius is 5.5: give a whole number"),
        ("module", "module.ranking=x", "module.ranking is x: give a number"),
        (
            "module",
            "module.network=[a]",
            "module.network is ['a']: give a configuration, with _target_, of a ScoreNetwork",
        ),
        (
            "module",
            "module.selector=3",
            "module.selector is 3: give a configuration, with _target_, of a PointSelector",
        ),
        ("module", "optim.optimizer._target_=[a]", "optim.optimizer._target_ is ['a']: give text, or null"),
        ("module", "optim.optimizer._partial_=1", "optim.optimizer._partial_ is 1: give true or false"),
        ("module", "optim.scheduler.eta_min=null", "optim.scheduler.eta_min is None: give a number"),
        ("module", "optim.scheduler.eta_min=x", "optim.scheduler.eta_min is x: give a number"),
        ("trainer", "trainer.log_every_n_steps=x", "trainer.log_every_n_steps is x: give a whole number, or null"),
        ("datamodule", "datamodule.index_folder=[a,b]", "datamodule.index_folder is ['a', 'b']: give a path"),
        ("logger", "logger.name={a: 1}", "logger.name is {'a': 1}: give text"),
        ("logger", "logger.save_dir=[a]", "logger.save_dir is ['a']: give a path"),
    ],
)
def test_the_key_and_what_it_takes_are_told(part, override, sentence):
    with pytest.raises(BadInputError) as told:
        build(training(override)[part])
    assert str(told.value) == sentence


@pytest.mark.parametrize("override", ["datamodule.overlap=1", "datamodule.budgets=[]", "data.max_side=null", "seed=3"])
def test_a_whole_number_is_a_number_and_null_is_taken_where_it_may_be(override):
    refuse_wrong_types(training(override).datamodule)


@pytest.mark.parametrize("override", ["logger.version=3", "logger.name=true", "seed=3"])
def test_a_number_is_taken_as_text_and_a_part_that_is_one_stays(override):
    for part in ("logger", "module", "datamodule"):
        refuse_wrong_types(training(override)[part])


@pytest.mark.parametrize(
    ("name", "wrong", "sentence"),
    [
        ("train", "init=[a.ckpt,b.ckpt]", "init is ['a.ckpt', 'b.ckpt']: give a path, or null"),
        ("train", "ckpt_path=[a,b]", "ckpt_path is ['a', 'b']: give a path, or null"),
        ("train", "seed=[1,2]", "seed is [1, 2]: give a whole number"),
        ("train", "seed={a: 1}", "seed is {'a': 1}: give a whole number"),
        ("train", "seed=-1", "seed is -1: give a whole number from 0 to 4294967295"),
        ("train", f"seed={2**32}", "seed is 4294967296: give a whole number from 0 to 4294967295"),
        (
            "train",
            "data._target_=my_package.frames",
            "datamodule.data._target_ is my_package.frames, which can't be imported: No module named 'my_package'",
        ),
        ("train", "trainer.profiler=true", "trainer.profiler is True: give simple, advanced or pytorch, or null"),
        (
            "train",
            "trainer.profiler=[a,b]",
            "trainer.profiler is ['a', 'b']: give simple, advanced or pytorch, or null",
        ),
        ("train", "trainer.profiler={a: 1}", "trainer.profiler is {'a': 1}: give simple, advanced or pytorch, or null"),
        ("train", "callbacks.average=text", "callbacks.average is text: give a configuration, with _target_, or null"),
        (
            "train",
            "callbacks.average={a: 1}",
            "callbacks.average is {'a': 1}: give a configuration, with _target_, or null",
        ),
        ("train", "callbacks.calibration.bins=0", "bins of the calibration is 0: give a whole number above 0"),
        (
            "train",
            "optim.optimizer.lr=-1",
            "the optimizer or its schedule (optim) can't be made: Invalid learning rate: -1",
        ),
        (
            "train",
            "module.optimizer=3",
            "the optimizer or its schedule (optim) can't be made: 'int' object is not callable",
        ),
        ("train", "k=2.5", "k is 2.5: give a whole number"),
        ("train", "compare=[a]", "compare is ['a']: give keys of sips-benchmark, as experiment=quickstart does"),
        ("train", "trainer.max_time=[1,2]", "trainer can't be made: 'list' object has no attribute 'total_seconds'"),
        ("train", "datamodule.budgets={a: 1}", "datamodule.budgets is {a: 1}: give a list in square brackets, [1,2]"),
        ("index", "workers=[1,2]", "workers is [1, 2]: give a whole number"),
        ("index", "overlap={a: 1}", "overlap is {'a': 1}: give a number"),
        ("index", "paths.indexes=[a,b]", "paths.indexes is ['a', 'b']: give a path, or null"),
        (
            "index",
            "data._target_=my_package.frames",
            "data._target_ is my_package.frames, which can't be imported: No module named 'my_package'",
        ),
        ("index", "data._target_=text", "data._target_ is text, which can't be imported: No module named 'text'"),
        ("index", "paths.indexes=null", "paths.indexes is None: give a path"),
        ("evaluate", "paths.run=[a,b]", "paths.run is ['a', 'b']: give a path"),
        ("evaluate", "paths.run=null", "paths.run is None: give a path"),
        ("evaluate", "paths.data=null", "paths.data is None: give a path"),
        ("evaluate", "ks={a: 1}", "ks is {a: 1}: give a list in square brackets, [1,2]"),
        ("export", "size={a: 1}", "size is {'a': 1}: give a list in square brackets, [1,2]"),
    ],
)
def test_commands_refuse_lists_and_mappings_for_single_values(command, frames, name, wrong, sentence):
    data = [] if name == "export" else [*(TINY if name == "train" else []), "data=folder", f"data.path={frames}"]
    assert command(name, *data, wrong).sentence == sentence


def test_what_is_not_ours_or_not_there_is_left_to_hydra():
    refuse_wrong_types(OmegaConf.create({"_target_": "fractions.Fraction", "numerator": "x"}))
    refuse_wrong_types(OmegaConf.create({"_target_": "sips_lit.nowhere.Nothing", "n": "x"}))
    refuse_wrong_types(OmegaConf.create({"a": [{"_target_": "sips_lit.detect.selection.PointSelector"}], "b": None}))


def test_lists_of_parts_are_looked_through():
    wrong = OmegaConf.create({"a": [{"_target_": "sips_lit.detect.selection.PointSelector", "nms_radius": "x"}]})
    with pytest.raises(BadInputError, match=r"^a\[0\]\.nms_radius is x: give a whole number$"):
        refuse_wrong_types(wrong)
