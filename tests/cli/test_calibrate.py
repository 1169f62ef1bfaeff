import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_runs import write_frames
from textured_scenes import flight

from sips_lit.cli.calibrate import coverage_rows
from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.recalibration import AS_TRAINED
from sips_lit.metrics.coverage import coverage

TINY = ["pairs=6", "k=4", "n_max=40", "calibration=[10,30]", "workers=1"]


@pytest.fixture
def mine(checkpoint, tmp_path) -> Path:
    """A checkpoint in a folder of its own."""
    (tmp_path / "run").mkdir()
    return Path(shutil.copy(checkpoint, tmp_path / "run" / "best.safetensors"))


@pytest.fixture
def calibrate(command, frames, mine, folders):
    """``calibrate("k=5")`` on a tiny sequence."""

    def run(*arguments: str):
        data = "data=folder", f"data.path={frames}", f"hydra.run.dir={folders}/report"
        return command("calibrate", f"checkpoint={mine}", *data, *TINY, *arguments)

    return run


@pytest.mark.draws
def test_a_new_file_with_the_same_points_and_other_probabilities(calibrate, mine, frames, folders):
    before = mine.read_bytes()
    result = calibrate()
    assert result.code == 0, result.err
    assert mine.read_bytes() == before
    output = mine.with_name("best_calibrated.safetensors")
    assert str(output) in result.out
    old, new = (SipsDetector.from_checkpoint(file) for file in (mine, output))
    assert old.recalibration == AS_TRAINED != new.recalibration
    image = frames / "003.png"
    np.testing.assert_array_equal(old(image, 40).xy, new(image, 40).xy)
    assert np.abs(old(image, 40).score - new(image, 40).score).max() > 0.01
    stored = json.loads(output.with_suffix(".json").read_text())
    assert stored["recalibration"] == new.recalibration.config
    assert "the later half of the pairs of its only sequence held back (3 pairs)" in result.out
    for word in ("ECE before", "as trained", "recalibrated, independent", "best fixed n", "difficulty"):
        assert word in result.out
    with (folders / "report" / "calibration.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["points"] for row in rows] == ["10", "30"]
    with (folders / "report" / "coverage.csv").open() as handle:
        assert len(list(csv.DictReader(handle))) == 3 * 5
    assert (folders / "report" / "recalibration.png").stat().st_size > 1000
    again = calibrate(f"checkpoint={output}", f"output={folders}/again.safetensors")
    assert again.code == 0, again.err
    assert load_checkpoint(folders / "again.safetensors")[1] == load_checkpoint(output)[1]


def test_detection_and_evaluation_use_it(calibrate, command, mine, frames, folders):
    assert calibrate().code == 0
    output = mine.with_name("best_calibrated.safetensors")
    detector = SipsDetector.from_checkpoint(output)
    given = f"checkpoint={output}", f"input={frames / '003.png'}", "k=4", "confidence=0.6", "n_max=40", "format=npz"
    assert command("detect", *given, f"output={folders}/points").code == 0
    with np.load(folders / "points" / "003.npz") as stored:
        expected, _ = detector.within(frames / "003.png", Budget(k=4, confidence=0.6, n_max=40))
        np.testing.assert_array_equal(stored["scores"], expected.score)
    data = (
        "data=folder",
        f"data.path={frames}",
        "calibration=[10]",
        "n_max=40",
        "n=10",
        "k=4",
        "pose=false",
        "pictures=false",
    )
    found = command("evaluate", f"checkpoint={output}", *data, "pairs=4", f"hydra.run.dir={folders}/evaluation")
    assert found.code == 0, found.err
    (of_set,) = json.loads((folders / "evaluation" / "results.json").read_text())["pair_sets"]
    bins = of_set["detectors"][0]["calibration"]["10"]["mean_score"]
    low, high = (detector(frames / "003.png", 10).score[at] for at in (-1, 0))
    assert all(value is None or value == "nan" or low - 0.1 < float(value) < high + 0.1 for value in bins)


def test_several_data_sets(calibrate, folders):
    for name in ("a", "b"):
        write_frames(folders / name, flight(8, size=(128, 96), seed=ord(name)).frames)
    sets = "{" + ",".join(f"{name}:{{data:{{path:{folders}/{name}}}}}" for name in "ab") + "}"
    given = f"pair_sets={sets}", "+data@pair_sets.a.data=folder", "+data@pair_sets.b.data=folder"
    result = calibrate(*given, "held_back=[b]", f"output={folders}/x.safetensors")
    assert result.code == 0, result.err
    assert "fitted to 3 pairs" in result.out
    assert "b: all held back (6 pairs)" in result.out
    wrong = calibrate(*given, "held_back=[c]", f"output={folders}/y.safetensors")
    assert wrong.sentence == "held_back names c, which is no pair set: choose among a, b"
    assert "names every pair set" in calibrate(*given, "held_back=[a,b]", f"output={folders}/y.safetensors").sentence


def test_a_file_is_only_replaced_when_told(calibrate, mine):
    assert "name a file that ends in .safetensors" in calibrate("output=x.ckpt").sentence
    assert "is there already" in calibrate(f"output={mine}").sentence
    mine.with_name("best_calibrated.json").touch()
    assert "is there already" in calibrate().sentence
    assert calibrate("overwrite=true").code == 0


@pytest.mark.parametrize(
    ("argument", "reason"),
    [
        ("descriptor=own", "choose descriptor=rootsift"),
        ("calibration=[0]", "calibration is [0]"),
        ("k=40", "k is 40 and n_max is 40"),
        ("held_back=[x]", "held_back names x"),
        ("checkpoint=gone.ckpt", "there is no checkpoint gone.ckpt"),
        ("pairs=1", "has a single pair"),
        ("overwrite=maybe", "overwrite"),
    ],
)
def test_values_that_are_refused(calibrate, mine, argument, reason):
    assert reason in calibrate(argument).sentence
    assert [path.name for path in mine.parent.iterdir()] == [mine.name]


def test_what_no_image_promises_has_an_empty_cell():
    inliers = np.array([[0, 1, 2], [0, 0, 1]])
    out_of_reach, kept = coverage(0.9, [None, None], inliers, 1), coverage(0.5, [1, 2], inliers, 1)
    assert coverage_rows({"as trained": [out_of_reach, kept]}) == [
        ["as trained", 0.9, None, 0, 2, None, None],
        ["as trained", 0.5, 1.0, 2, 0, 1.5, 2],
    ]
