import json

import numpy as np
import pytest
import rgbd_files

SMALL = ["detectors=[sift,orb]", "iterations=100", "repeats=1"]


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    return rgbd_files.write_simple(tmp_path_factory.mktemp("desk"))


@pytest.mark.draws
def test_a_trajectory_of_each_detector(command, desk, folders):
    result = command("odometry", "data=rgbd", f"data.path={desk}", *SMALL, "n=[30,100]", f"hydra.run.dir={folders}/run")
    assert result.code == 0, result.err
    for text in ("| drift, %", "SIFT + RootSIFT", "| ORB ", "n = 30", "4 frames, depth from maps", "wrote:"):
        assert text in result.out
    stored = json.loads((folders / "run" / "results.json").read_text())
    assert [m["key"] for m in stored["sequences"][0]["methods"][::2]] == [
        "sift",
        "sift_rootsift",
        "orb",
        "orb_rootsift",
    ]
    (own,) = (folders / "run" / "trajectories").glob("*/sift/n100_seed0.tum")
    true = np.loadtxt(own.parents[1] / "truth.tum")
    np.testing.assert_allclose(np.loadtxt(own)[:, 1:4], true[:, 1:4], atol=0.02)  # of 0.24 m


def test_one_detector(command, desk, folders, checkpoint):
    given = f"checkpoint={checkpoint}", "iterations=50", "repeats=1", "n=100"
    result = command("odometry", "data=rgbd", f"data.path={desk}", *given)
    assert result.code == 0, result.err
    assert "| SIPs + RootSIFT | 100 |" in " ".join(result.out.split())
    assert "RPE, deg" in result.out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["n=3"], "n is 3, but a pose needs min_inliers = 6"),
        (["n=fifty"], "n is fifty: give points a frame"),
        (["n=[]"], "n is []"),
        (["n=50.5"], "n is 50.5: give points a frame"),
        (["max_frames=1"], "max_frames is 1"),
        (["min_inliers=2"], "min_inliers is 2"),
        (["repeats=many"], "repeats has a value of the wrong type"),
        (["detectors=[superpoint]"], "no method could be made: "),
        (["detectors=[shi_tomasi]", "descriptor=own"], "no method could be made: Shi-Tomasi does not describe"),
        (
            ["detector=shi_tomasi", "descriptor=own", "detectors=null"],
            "no method could be run: Shi-Tomasi finds points",
        ),
    ],
)
def test_bad_input_is_one_sentence(command, desk, arguments, sentence):
    assert sentence in command("odometry", "data=rgbd", f"data.path={desk}", *SMALL, *arguments).sentence


def test_data_without_depth_is_one_sentence(command, frames):
    told = command("odometry", "data=folder", f"data.path={frames}", *SMALL).sentence
    assert "there is no camera calibration of" in told
    assert "use stereo, RGB-D or posed depth" in told
