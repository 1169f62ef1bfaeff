"""Keys that a command does not have end it with the nearest one, however they are written."""

import pytest

from sips_lit.cli.keys import arguments_of, nearest, own_keys, plain_config, unknown_key

DATA = ("data=folder", "data.path=x")
COMMANDS = ("train", "index", "evaluate", "benchmark", "calibrate")


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("plus", ["", "+", "++"])
def test_a_key_that_nobody_reads_is_refused_by_every_command(command, name, plus):
    sentence = command(name, *DATA, f"{plus}data.pahts=1").sentence
    assert sentence == f"nothing in sips-{name} reads the key data.pahts: did you mean data.path?"


@pytest.mark.parametrize(
    ("name", "near"), [("detect", "checkpoint"), ("export", "checkpoint"), ("benchmark", "checkpoint")]
)
@pytest.mark.parametrize("plus", ["", "+", "++"])
def test_a_key_of_a_command_itself(command, name, near, plus):
    more = [] if name == "benchmark" else ["output=o"]
    assert command(name, *more, f"{plus}chekpoint=x").sentence.endswith(f"did you mean {near}?")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["data=vidoe"], "there is no data=vidoe: did you mean video? Else choose among demo, "),
        (["data@vl_data=video"], "did you mean data@val_data?"),
        (["model=smal", *DATA], "did you mean small?"),
        (["dta=video"], "did you mean data?"),
        (["+epochs=3", *DATA], "reads the key epochs: a run is counted in steps, not in epochs (--help has the number)"),
        (["trainer.max_epochs=3", *DATA], "counted in steps, not in epochs (--help has the number): set trainer.max_steps="),
        (["--max-epochs", "3", *DATA], "there is no option --max-epochs: a run is counted in steps, not in epochs"),
        (["experiment=quickstart", "data.sources.city.wait=3"], "did you mean data.sources.city.weight? Else write +data"),
        (["lr=1", *DATA], "did you mean optim.optimizer.lr?"),
        (["+optim.optimizer.weight_dcay=1", *DATA], "did you mean optim.optimizer.weight_decay?"),
        (["+trainer.overfit_batch=2", *DATA], "did you mean trainer.overfit_batches?"),
        (["trainer.overfit_batches=2", *DATA], "Trainer takes it: write +trainer.overfit_batches=..."),
        (["+seed=2", *DATA], "seed is a key of sips-train already: write seed=... without the +"),
        (["+data=video"], "data is a key of sips-train already: write data=... without the +"),
        (["++data=video"], "data is a key of sips-train already: write data=... without the +"),
        (["seed=0,1", *DATA], "add -m to run each of them, or write seed=[0,1] for a list"),
        (["~sed", *DATA], "did you mean seed?"),
        (["hydra.run.dri=x", *DATA], "did you mean hydra.run.dir?"),
        (["hydra/launcher=jblib", *DATA], "did you mean joblib?"),
        (["experiment=quickstart", "+compare.pars=3"], "reads the key compare.pars: did you mean compare.pairs?"),
        (["experiment=quickstart", "+data.sources.city.wait=3"], "did you mean data.sources.city.weight?"),
        (["--init", "sips-small", *DATA], "there is no option --init: a key is written key=value, without dashes, here "),
    ],
)  # fmt: skip
def test_what_was_meant_is_named(command, arguments, told):
    assert told in command("train", *arguments).sentence


@pytest.mark.parametrize("key", ["pair_sets.easy.pairs", "pair_sets.easy.inliers.threshold"])
def test_a_key_below_names_of_ones_own_needs_a_plus(command, key):
    sentence = command("benchmark", *DATA, f"{key}=40").sentence
    assert sentence == f"the configuration has no {key}: write +{key}=... to add it"


def test_the_most_alike_name():
    names = ["pairs", "overlap", "optim.optimizer.lr", "data.path", "data.cache_dir", "trainer.max_steps"]
    assert nearest("n_pairs", names) == "pairs"
    assert nearest("trainer.lr", names) == "optim.optimizer.lr"
    assert nearest("path", names) == "data.path"
    assert nearest("epochs", names) == "trainer.max_steps"
    assert nearest("epochs", ["pairs"]) is None
    assert nearest("x", names) is None
    assert nearest("x", []) is None


def test_arguments_of_a_constructor():
    assert arguments_of("sips_lit.describe.sift.RootSift") == {"size", "shrink"}
    assert arguments_of("builtins.dict") is None
    assert arguments_of("sips_lit.nowhere.Nothing") is None
    assert "max_epochs" in (arguments_of("lightning.Trainer") or ())


def test_keys_follow_the_choices_of_groups():
    assert "data.crop_bottom" in own_keys(plain_config("train", ["data=robotcar", "data.nonsense=3"]))
    assert "data.crop_bottom" not in own_keys(plain_config("train"))
    assert not any(key.startswith("hydra") for key in own_keys(plain_config("train")))


def test_without_a_guess_the_list_is_named():
    assert (
        unknown_key("x", "index", {})
        == "nothing in sips-index reads the key x: sips-index --cfg job shows those that there are"
    )
