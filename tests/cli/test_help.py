import shlex
import tomllib

import pytest
from cli_runs import ROOT
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import sips_lit
from sips_lit.cli.app import register_resolvers
from sips_lit.cli.arguments import as_typed, with_keys
from sips_lit.cli.conf_files import CONF_DIR, head
from sips_lit.cli.help import answer, help_text

COMMANDS = sorted(path.stem for path in CONF_DIR.glob("*.yaml"))


def composed(command: str, *arguments: str):
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose(command, as_typed(with_keys(command, arguments)))


@pytest.mark.parametrize("command", COMMANDS)
def test_a_help_fits_a_screen(command):
    lines = help_text(command, 100).splitlines()
    assert len(lines) <= 40
    path = str(CONF_DIR)  # a folder of the machine, as long as it is
    assert [line for line in lines if len(line) > 100 and path not in line] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_help_has_a_purpose_examples_that_compose_and_keys_with_comments(command):
    top, text = head(command), help_text(command, 100)
    assert len(top.purpose) == 2
    assert len(top.examples) == 3
    for line in (*top.purpose, *top.examples):
        assert line in text
    for example in top.examples:
        name, *arguments = shlex.split(example)
        assert name == f"sips-{command}"
        composed(command, *(argument for argument in arguments if argument not in ("-m", "seed=0,1,2")))
    config = composed(command, *(["data=video"] if "data" in top.keys else []))
    for key in top.keys:
        (row,) = [line for line in text.splitlines() if line.startswith(f"  {key} ")]
        assert len(row.split()) > 2, f"{key} has no comment"
        parent, _, last = key.rpartition(".")
        groups = [path.name for path in CONF_DIR.iterdir()]
        assert key in groups or last in list(OmegaConf.select(config, parent) if parent else config)


def test_a_narrow_terminal_gets_narrow_lines():
    path = str(CONF_DIR)
    lines = help_text("detect", 70).splitlines()[7:]  # purpose and examples stay as they are
    assert all(len(line) <= 70 or path in line for line in lines)


def test_questions_are_answered():
    assert answer("train", ["data=video", "-h"]) == help_text("train")
    assert answer("train", ["--version"]) == f"sips-train {sips_lit.__version__}"
    assert answer("train", ["--cfg", "job"]) is None


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_every_command_answers(command, option):
    for name in COMMANDS:
        result = command(name, option)
        assert result.code == 0
        assert f"sips-{name} " in result.out


def test_every_command_of_the_package_with_a_configuration_is_started_lightly():
    with (ROOT / "pyproject.toml").open("rb") as file:
        scripts = tomllib.load(file)["project"]["scripts"]
    for name in COMMANDS:
        assert scripts[f"sips-{name}"] == f"sips_lit.cli.start:{name}"
