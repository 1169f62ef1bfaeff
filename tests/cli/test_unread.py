from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from sips_lit.cli.app import register_resolvers
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.unread import known_keys, refuse_unread
from sips_lit.errors import BadInputError

EXPERIMENTS = sorted(path.stem for path in (CONF_DIR / "experiment").glob("*.yaml"))
COMMANDS = sorted(path.stem for path in CONF_DIR.glob("*.yaml"))


def composed(command: str, *overrides: str):
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose(command, list(overrides))


def of_command(experiment: str) -> str:
    begin = experiment.partition("_")[0]
    return begin if begin in COMMANDS else "train"


@pytest.mark.parametrize("command", COMMANDS)
def test_all_that_a_command_has_is_read(command):
    refuse_unread(composed(command), command)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_all_that_an_experiment_sets_is_read(name):
    command = of_command(name)
    refuse_unread(composed(command, f"experiment={name}"), command)


@pytest.mark.parametrize("name", sorted(path.stem for path in (CONF_DIR / "data").glob("*.yaml")))
def test_every_data_set_is_read(name):
    refuse_unread(composed("train", f"data={name}"), "train")


@pytest.mark.parametrize(
    "added",
    [
        "+trainer.overfit_batches=2",
        "+optim.optimizer.weight_decay=0.1",
        "+callbacks.rate={_target_:lightning.pytorch.callbacks.LearningRateMonitor,logging_interval:step}",
    ],
)
def test_what_a_constructor_takes_can_be_added(added):
    refuse_unread(composed("train", "data=folder", added), "train")


def test_what_an_interpolation_leads_to_is_read():
    refuse_unread(composed("train", "+mine.size=9", "descriptor.size=${mine.size}"), "train")
    with pytest.raises(BadInputError, match="reads the key mine"):
        refuse_unread(composed("train", "+mine.size=9"), "train")


def test_a_typo_in_a_file_of_the_user_is_found(tmp_path: Path, command):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text("# @package _global_\noverlp: 0.3\n")
    arguments = f"hydra.searchpath=[file://{tmp_path}]", "experiment=mine", "data=folder", "data.path=x"
    assert command("benchmark", *arguments).sentence == (
        "nothing in sips-benchmark reads the key overlp: did you mean overlap?"
    )


def test_names_that_the_user_gives_are_free():
    config = composed(
        "benchmark", "+pair_sets.easy={pairs: 3}", "+pair_sets.wide={data: {_target_: builtins.dict, a: 1}}"
    )
    refuse_unread(config, "benchmark")
    bad = composed("benchmark", "+pair_sets.a={data: {_target_: sips_lit.frames.folder.folder, pth: x}}")
    with pytest.raises(BadInputError, match=r"pair_sets\.a\.data\.pth: did you mean pair_sets\.a\.data\.path\?"):
        refuse_unread(bad, "benchmark")


def test_known_keys_are_those_of_the_composed_configuration():
    for command in COMMANDS:
        assert set(OmegaConf.to_container(composed(command))) <= known_keys(command)[""]
