import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.methods import configured_method, known_detectors, make_methods, parse_entries
from sips_lit.errors import BadInputError


@pytest.fixture(autouse=True)
def hydra():
    """Names of detectors are those of Hydra's search path."""
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        yield


def methods(*overrides: str):
    config, skipped = compose("benchmark", ["paths.run=x", *overrides]), {}
    made = make_methods(config, skipped.__setitem__)
    return {method.key: method for method in made}, skipped


def test_with_its_own_descriptor_and_the_common_one():
    made, skipped = methods("detectors=[sift,orb,shi_tomasi]")
    assert [c.name for c in made.values()] == [
        "SIFT",
        "SIFT + RootSIFT",
        "ORB",
        "ORB + RootSIFT",
        "Shi-Tomasi + RootSIFT",
    ]
    assert list(made) == ["sift", "sift_rootsift", "orb", "orb_rootsift", "shi_tomasi_rootsift"]
    assert not skipped
    assert made["sift"].descriptor is None
    assert len({str(c.signature) for c in made.values()}) == 5


def test_without_a_common_descriptor():
    made, skipped = methods("detectors=[sift,shi_tomasi]", "descriptor=own")
    assert list(made) == ["sift"]
    assert "does not describe its points" in skipped["shi_tomasi"]


def test_overrides(checkpoint):
    made, _ = methods("detectors=[{orb:{fast_threshold:20}},orb]", "descriptor=own")
    assert [c.name for c in made.values()] == ["ORB (fast_threshold 20)", "ORB"]
    assert made["orb_fast_threshold_20"].detector.fast_threshold == 20
    assert made["orb_fast_threshold_20"].signature != made["orb"].signature


def test_several_checkpoints(checkpoint):
    made, skipped = methods(f"detectors=[{{sips:{{path:{checkpoint}}}}}, sips]", f"checkpoint={checkpoint}")
    assert [c.name for c in made.values()] == [f"SIPs (path {checkpoint.name}) + RootSIFT", "SIPs + RootSIFT"]
    assert not skipped


def test_a_detector_that_can_not_be_made_is_left_out(tmp_path):
    made, skipped = methods("detectors=[sips,superpoint,sift]", "descriptor=own")
    assert list(made) == ["sift"]
    assert "give a common descriptor" in skipped["sips"]  # SIPs have no own one
    assert "weights" in skipped["superpoint"]
    _, skipped = methods("detectors=[sips]", f"checkpoint={tmp_path}/gone.ckpt")
    assert "there is no checkpoint" in skipped["sips"]


def test_all():
    assert [entry.detector for entry in parse_entries("all")] == known_detectors()
    assert {"sips", "sift", "orb", "random", "grid"} <= set(known_detectors())


def test_a_class_of_ones_own():
    target = "sips_lit.baselines.fast.Fast"
    made, _ = methods(f"detectors=[fast,{{mine:{{_target_:{target},threshold:30}}}}]")
    assert [m.name for m in made.values()] == ["FAST + RootSIFT", "FAST (threshold 30) + RootSIFT"]
    assert list(made) == ["fast_rootsift", "mine_threshold_30_rootsift"]
    assert made["mine_threshold_30_rootsift"].detector.threshold == 30


@pytest.mark.parametrize(
    ("detector", "key", "name"), [("sift", "sift", "SIFT"), ("fast", "fast_rootsift", "FAST + RootSIFT")]
)
def test_one_detector_with_one_descriptor(detector, key, name):
    descriptor = "own" if detector == "sift" else "rootsift"
    config = compose("evaluate", ["paths.run=x", f"detector={detector}", f"descriptor={descriptor}"])
    method = configured_method(config)
    assert (method.key, method.name) == (key, name)
    assert (method.descriptor is None) == (descriptor == "own")


@pytest.mark.parametrize(
    ("detectors", "words"),
    [
        (["sift", "siftt"], "there is no detector siftt: choose from .*shi_tomasi"),
        (["sift", "sift"], "has sift twice"),
        ([{"sips": {"path": "a/b.ckpt"}}, {"sips": {"path": "a/b.ckpt"}}], "has sips_path_b.ckpt twice"),
        ([], "give all, or a list"),
        ([3], "has the entry 3"),
        ([{"sift": {}, "orb": {}}], "has the entry"),
        ([{"orb": {"nonsense": 1}}], "sets nonsense of orb, which has no such key"),
        ([{"orb": 5}], "has the entry"),
        (7, "detectors is 7"),
    ],
)
def test_what_is_refused_before_anything_runs(detectors, words):
    config = compose("benchmark", ["paths.run=x"])
    config.detectors = OmegaConf.create({"d": detectors}).d
    with pytest.raises(BadInputError, match=words):
        make_methods(config, lambda key, reason: None)


def entries_of(*paths: str) -> list[tuple[str, str]]:
    return [(entry.key, entry.note) for entry in parse_entries([{"sips": {"path": path}} for path in paths])]


def test_files_of_one_name_are_told_apart_by_their_folders():
    runs = [f"/w/train/{run}/checkpoints/best.ckpt" for run in ("a", "b")]
    assert entries_of(*runs, "/w/c.ckpt") == [
        ("sips_path_a_checkpoints_best.ckpt", " (path a/checkpoints/best.ckpt)"),
        ("sips_path_b_checkpoints_best.ckpt", " (path b/checkpoints/best.ckpt)"),
        ("sips_path_c.ckpt", " (path c.ckpt)"),
    ]
    assert [note for _, note in entries_of("best.ckpt", "a/best.ckpt", "b/c/best.ckpt")] == [
        " (path best.ckpt)",
        " (path a/best.ckpt)",
        " (path c/best.ckpt)",
    ]
    assert entries_of("/best.ckpt", "a/best.ckpt")[0][1] == " (path /best.ckpt)"


def test_one_file_in_several_ways_is_told_by_what_differs():
    entries = parse_entries([{"sips": {"path": "/w/a/best.ckpt", "octaves": octaves}} for octaves in (1, 2)])
    assert [entry.note for entry in entries] == [f" (path best.ckpt, octaves {octaves})" for octaves in (1, 2)]


def test_one_name_is_a_list():
    assert [entry.key for entry in parse_entries("sift")] == ["sift"]
