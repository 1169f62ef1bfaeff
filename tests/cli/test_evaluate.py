import csv
import hashlib
import json

import numpy as np
import pytest
import torch
from cli_runs import write_frames
from textured_scenes import texture

from sips_lit.baselines.sift import SiftDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.runner import evaluate_detector
from sips_lit.frames.folder import folder
from sips_lit.inliers.klt import KltInliers


@pytest.fixture
def evaluate(command, frames, folders):
    """``evaluate("detector=sift")`` evaluates on a tiny sequence."""

    def run(*arguments: str, into: str = "run"):
        data = "data=folder", f"data.path={frames}", f"hydra.run.dir={folders}/{into}"
        return command("evaluate", *data, "pairs=4", "k=8", "n_max=60", "ks=[]", "n=20", "calibration=[20]", *arguments)

    return run


def stored(folder) -> dict:
    """The one method of the one pair set in results.json."""
    (pair_set,) = json.loads((folder / "results.json").read_text())["pair_sets"]
    (method,) = pair_set["detectors"]
    return method


@pytest.mark.draws
def test_a_checkpoint(evaluate, folders, checkpoint):
    result = evaluate(f"checkpoint={checkpoint}")
    assert result.code == 0, result.err
    assert "\nmethod " in result.out
    assert "SIPs + " in result.out
    said = " ".join(result.out.split())  # lines break anywhere
    for part in (
        "k = 8, ",
        "at most 60 points",
        "4 pairs (kind=random, overlap=0.5, seed=0)",
        "exact search",
        "inliers=klt",
    ):
        assert part in said
    written = [line.strip() for line in result.out.split("wrote:\n")[1].splitlines()]
    run = folders / "run"
    names = {
        "report.html",
        "results.json",
        "summary.csv",
        "summary.md",
        "folder_plane/sips_rootsift_pairs.csv",
        "folder_plane/sips_rootsift_all.csv",
    }
    names |= {f"pictures/folder_plane/sips_rootsift_{which}.png" for which in ("best", "median", "worst")}
    assert {str(run / name) for name in names if "/" not in name} <= set(written)
    assert {f"{run}/folder_plane/ (2 files)", f"{run}/pictures/ (3 files)"} <= set(written)
    assert all((run / name).stat().st_size for name in names)
    found = stored(run)
    protocol = found["protocol"]
    assert (protocol["k"], protocol["n_max"], protocol["seed"], protocol["pairs"]) == (8, 60, 0, 4)
    assert protocol["search"] == "exact"
    assert protocol["verification"][0]["threshold"] == 3.0
    assert protocol["versions"]["torch"] == torch.__version__
    assert protocol["descriptor"]
    digest = hashlib.sha256(checkpoint.read_bytes()).hexdigest()
    assert protocol["checkpoint"] == f"{checkpoint.name} (sha256 {digest[:12]})"
    assert found["calibration"]["20"]["ece"] >= 0
    with (run / "folder_plane" / "sips_rootsift_pairs.csv").open() as handle:
        assert len(list(csv.DictReader(handle))) == 4


def test_the_same_result_twice(evaluate, folders, checkpoint):
    for run in ("one", "two"):
        assert evaluate(f"checkpoint={checkpoint}", f"features={folders}/{run}_features", into=run).code == 0
    one, two = (stored(folders / run) for run in ("one", "two"))
    assert {**one, "milliseconds": 0} == {**two, "milliseconds": 0}
    name = "folder_plane/sips_rootsift_all.csv"
    assert (folders / "one" / name).read_text() == (folders / "two" / name).read_text()


@pytest.mark.parametrize("detector", ["sift", "orb"])
@pytest.mark.parametrize("descriptor", ["own", "rootsift"])
def test_detectors_with_descriptors_of_their_own_or_a_common_one(evaluate, folders, detector, descriptor):
    result = evaluate(f"detector={detector}", f"descriptor={descriptor}")
    assert result.code == 0, result.err
    found = stored(folders / "run")
    assert (found["protocol"]["descriptor"] == "own") == (descriptor == "own")
    assert found["calibration"] == {}
    assert all(n == "inf" or 8 <= n <= 60 for (needed,) in found["n_k"] for n in needed)
    assert any(n != "inf" for (needed,) in found["n_k"] for n in needed)


def test_the_same_numbers_as_a_call(evaluate, folders, frames):
    assert evaluate("detector=sift", "descriptor=own").code == 0
    measures = Measures(k=8, ks=(), n_max=60, n=20)
    found = evaluate_detector(SiftDetector(), folder(frames), KltInliers(), pairs=4, measures=measures)
    needed = [float(n) for ((n,),) in stored(folders / "run")["n_k"]]
    np.testing.assert_array_equal(found.n_k[:, 0, 0], needed)


@pytest.mark.parametrize("detector", ["fast", "shi_tomasi", "harris", "random", "grid"])
def test_every_other_detector(evaluate, detector):
    result = evaluate(f"detector={detector}")
    assert result.code == 0, result.err


def test_points_without_descriptors(evaluate):
    sentence = evaluate("detector=shi_tomasi", "descriptor=own").sentence
    assert "does not describe them: choose descriptor=rootsift" in sentence


def test_learned_points_without_descriptors(evaluate, checkpoint):
    sentence = evaluate(f"checkpoint={checkpoint}", "descriptor=own").sentence
    assert "does not describe them: choose descriptor=rootsift" in sentence


def test_search_by_halving(evaluate, folders, checkpoint):
    exact, binary = {}, {}
    for search, needed in (("exact", exact), ("binary", binary)):
        result = evaluate(f"checkpoint={checkpoint}", f"search={search}", into=search)
        assert result.code == 0, result.err
        with (folders / search / "folder_plane" / "sips_rootsift_pairs.csv").open() as handle:
            needed |= {row["name"]: float(row["nmin"]) for row in csv.DictReader(handle)}
    assert exact.keys() == binary.keys()
    assert all(exact[pair] <= binary[pair] for pair in exact)


def test_an_unknown_search(evaluate, checkpoint):
    assert "search" in evaluate(f"checkpoint={checkpoint}", "search=guess").sentence


def test_no_checkpoint(evaluate, tmp_path):
    assert f"there is no checkpoint {tmp_path}/gone.ckpt" in evaluate(f"checkpoint={tmp_path}/gone.ckpt").sentence


def test_a_damaged_checkpoint(evaluate, tmp_path):
    for content in (b"", b"bad\n", b"\x80\x02}q\x00.", b"PK\x03\x04 half"):
        (tmp_path / "bad.ckpt").write_bytes(content)
        assert f"{tmp_path}/bad.ckpt" in evaluate(f"checkpoint={tmp_path}/bad.ckpt").sentence


def test_a_checkpoint_of_another_architecture(evaluate, tmp_path):
    network = ScoreNetwork(3, 4)
    state = {f"network.{name}": value for name, value in network.state_dict().items()}
    hyper = {"network": {**network.config, "width": 8}, "selector": {"nms_radius": 5, "subpixel": True}}
    torch.save({"state_dict": state, "hyper_parameters": hyper}, tmp_path / "other.ckpt")
    sentence = evaluate(f"checkpoint={tmp_path}/other.ckpt").sentence
    assert "is not a checkpoint of a sips_lit score network" in sentence
    torch.save({"state_dict": {}, "hyper_parameters": {"lr": 1}}, tmp_path / "foreign.ckpt")
    assert "foreign.ckpt" in evaluate(f"checkpoint={tmp_path}/foreign.ckpt").sentence


def test_frames_that_do_not_overlap(command, tmp_path):
    folder = write_frames(tmp_path / "cuts", [texture(80, 96, seed) for seed in range(5)])
    sentence = command("evaluate", "data=folder", f"data.path={folder}", "detector=sift", "descriptor=own").sentence
    assert "no two frames of cuts overlap by 0.5" in sentence


def test_impossible_numbers(evaluate):
    assert "k" in evaluate("detector=sift", "k=60").sentence
    assert "pairs" in evaluate("detector=sift", "pairs=0").sentence


def test_verification_that_the_data_can_not_give(evaluate):
    for inliers in ("homography", "pose_depth"):
        assert evaluate("detector=sift", f"inliers={inliers}").sentence
