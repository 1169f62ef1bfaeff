import pytest
import yaml

from sips_lit.cli.conf_files import CONF_DIR, describe_key, described_keys, head, options_of


def nested(node, prefix=""):
    """The keys of a plain YAML file, with dots."""
    for name, value in node.items():
        yield f"{prefix}{name}"
        if isinstance(value, dict):
            yield from nested(value, f"{prefix}{name}.")


@pytest.mark.parametrize("path", ["data/euroc", "callbacks/default", "datamodule/pairs", "model/small", "detect"])
def test_keys_are_those_that_a_yaml_parser_finds(path):
    file = CONF_DIR / f"{path}.yaml"
    expected = set(nested(yaml.safe_load(file.read_text())))
    assert {key for key in described_keys(file) if not key.startswith("defaults.")} == expected


def test_values_and_comments(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "# of the file\ndefaults:\n  - data: video  # which\n  - _self_\na: 1   # one,\n       # and more\n\n# of none\n"
        "b:\n  c: x # y\nd: [1, 2]\n"
    )
    found = described_keys(tmp_path / "a.yaml")
    assert {key: (one.value, one.comment) for key, one in found.items()} == {
        "defaults": ("", ""),
        "defaults.data": ("video", "which"),
        "a": ("1", "one, and more"),
        "b": ("", ""),
        "b.c": ("x", "y"),
        "d": ("[1, 2]", ""),
    }


def test_a_key_is_found_wherever_its_command_has_it():
    assert describe_key("train", "seed").value == "0"
    assert describe_key("train", "data").value == "video"
    assert describe_key("train", "trainer.max_steps").value == "2000"
    assert describe_key("evaluate", "n_max").comment.startswith("points per image")
    with pytest.raises(KeyError):
        describe_key("train", "trainer.nonsense")


def test_what_follows_the_keys_is_not_told():
    assert len(head("index").purpose) == 2
    assert "shard" in head("index").keys


def test_options_are_the_files_of_a_group():
    assert options_of("model") == ["paper", "paper_hpatches", "small", "tiny"]
    assert options_of("seed") == []


MEANINGS = {
    "k": "inliers that a pair needs",
    "n": "points per image, the best",
    "n_max": "points per image, at most",
    "pairs": "random pairs, fixed by the seed",
    "overlap": "least overlap of a pair",
    "seed": "of ",
}


@pytest.mark.parametrize(
    "path", [*CONF_DIR.glob("*.yaml"), *(CONF_DIR / "evaluation").glob("*.yaml")], ids=lambda p: p.stem
)
def test_a_name_means_the_same_in_every_command(path):
    for key, entry in described_keys(path).items():
        if key in MEANINGS:
            assert entry.comment.startswith(MEANINGS[key]), f"{path.name} says of {key}: {entry.comment}"
