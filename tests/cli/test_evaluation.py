import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf, open_dict

from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.evaluation import best_auc, make_pair_sets
from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult


@pytest.fixture
def config(frames, folders):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        yield compose(
            "benchmark",
            ["data=folder", f"data.path={frames}", f"paths.run={folders}/run", "pairs=3", "n_max=40", "n=20"],
        )


def test_without_entries_there_is_one_pair_set_of_the_keys(config, folders):
    ((pairs, measures),) = make_pair_sets(config, folders / "run")
    assert (pairs.key, pairs.title, len(pairs)) == ("folder_plane", "folder of images: plane", 3)
    assert (measures.n_max, measures.n, measures.k) == (40, 20, 10)
    assert pairs.protocol["overlap"] == 0.5
    assert len((folders / "run" / "folder_plane" / "pairs.csv").read_text().splitlines()) == 4


def test_an_entry_overrides_the_keys_for_its_own(config, folders):
    config.pair_sets = OmegaConf.create(
        {"wide": {"title": "Wide pairs", "overlap": 0.2, "k": 4}, "first": {"kind": "first_to_others"}, "gone": None}
    )
    (wide, at_wide), (first, at_first) = make_pair_sets(config, folders / "run")
    assert (wide.title, at_wide.k, at_wide.n_max, wide.protocol["overlap"]) == ("Wide pairs", 4, 40, 0.2)
    assert (first.title, at_first.k, first.protocol["kind"]) == ("first", 10, "first_to_others")
    assert "overlap" not in first.protocol
    assert {p.index0 for p in first.listed} == {0}


def test_poses_that_are_not_known_can_not_be_refined(config, folders):
    config.pair_sets = OmegaConf.create({"a": {}, "b": {"refine_poses": True}})
    with pytest.raises(BadInputError, match=r"refine_poses needs poses, cameras and depth, which .* does not have"):
        make_pair_sets(config, folders / "run")


def test_keys_that_no_pair_set_has(config, folders):
    config.pair_sets = OmegaConf.create({"a": {"nonsense": 1}})
    with pytest.raises(
        BadInputError, match=r"pair_sets\.a sets nonsense, which no pair set has: it can set title, data"
    ):
        make_pair_sets(config, folders / "run")


NOT_NULL = """k ks n n_max budgets search repeats calibration pose threshold cells
kind pairs overlap seed refine_poses workers features video_frames pictures data inliers"""


@pytest.mark.parametrize("key", NOT_NULL.split())
def test_keys_that_can_not_be_null(config, folders, key):
    config[key] = None
    with pytest.raises(BadInputError, match=rf"^{key} (is|has) "):
        make_pair_sets(config, folders / "run")


@pytest.mark.parametrize(
    ("pair_sets", "told"),
    [
        ({"city": {"pairs": None}}, r"pair_sets\.city: pairs has a value of the wrong type"),
        ({"city": {"n": 0}}, r"pair_sets\.city: n is 0"),
        ({"city": {"k": "many"}}, r"pair_sets\.city: k is many: give a whole number"),
        ({"city": {"data": None}}, r"pair_sets\.city: data is not set"),
        ({"city": 3}, "pair_sets is "),
        ([1], "pair_sets is "),
        ("city", "pair_sets is city"),
    ],
)
def test_pair_sets_that_are_none(config, folders, pair_sets, told):
    with open_dict(config):
        config.pair_sets = pair_sets
    with pytest.raises(BadInputError, match=told):
        make_pair_sets(config, folders / "run")


def test_nobody_was_measured():
    assert best_auc([PairSetResult("a", "A", {}, (), {})]) != best_auc([PairSetResult("a", "A", {}, (), {})])
