import pytest

from sips_lit.cli.options import refuse_options, sweep_first
from sips_lit.errors import BadInputError


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--checkpoint", "a.ckpt"], "there is no option --checkpoint: .*, here checkpoint=a.ckpt$"),
        (["--checkpoint=a.ckpt", "n=5"], "here checkpoint=a.ckpt$"),
        (["-n", "50"], "there is no option -n: .* here n=50$"),
        (["--n-max", "n=5"], r"here n_max=\.\.\.$"),
        (["input=x", "--chekpoint", "a"], "here checkpoint=a$"),
        (["--colour"], "see --help$"),
    ],
)
def test_the_right_form_is_shown(arguments, told):
    with pytest.raises(BadInputError, match=told):
        refuse_options(arguments, lambda: {"checkpoint", "n", "n_max", "input"})


@pytest.mark.parametrize(
    "arguments",
    [
        ["-m", "a=1,2"], ["--cfg", "job"], ["-c", "job", "--resolve"], ["--info"], ["--config-dir", "-x"], ["--hydra-help"],
        ["a=-5", "b=--x"], ["-sc", "install=bash"], ["--config-name=train"],
    ],
)  # fmt: skip
def test_hydras_own_options_pass(arguments):
    refuse_options(arguments, set)


def test_a_sweep_may_be_asked_for_anywhere():
    assert sweep_first(["a=1", "-m", "b=1,2"]) == ["-m", "a=1", "b=1,2"]
