import csv
import json

import numpy as np
import pytest
from stereo_scenes import StereoScene
from tiny_methods import method

from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.odometry.odometer import OdometrySettings
from sips_lit.odometry.report import figures, matrix, protocol_line, table, write_results
from sips_lit.odometry.runner import Plan, run_sequence

METHODS = [method(SiftDetector(), RootSift(), "sift"), method(OrbDetector(), None, "orb")]


@pytest.fixture(scope="module")
def result():
    plan = Plan((20, 100), OdometrySettings(iterations=50), repeats=2)
    return run_sequence(StereoScene(3, "depth"), METHODS, plan)


def test_files(result, tmp_path):
    written = write_results(tmp_path, [result], "2026-01-01")
    assert all(path.is_file() for path in written)
    names = {str(path.relative_to(tmp_path)) for path in written}
    assert {"results.json", "results.csv", "table.md", "boards_trajectories.png", "boards_drift.png"} <= names
    assert {
        f"trajectories/boards/{stem}" for stem in ("truth.tum", "sift/n20_seed1.tum", "orb/n100_seed0.kitti")
    } <= names
    stored = json.loads((tmp_path / "results.json").read_text())
    run = stored["sequences"][0]["methods"][1]["runs"][0]
    assert run["errors"]["ate"] == result.results[1].runs[0].errors.ate
    assert run["keyframes"][0] == 0
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["n"]) for row in rows] == [
        ("sift", "20"),
        ("sift", "100"),
        ("orb", "20"),
        ("orb", "100"),
    ]
    assert float(rows[1]["drift"]) == result.results[1].error("drift")[0]
    assert float(rows[3]["bytes"]) == result.results[3].bytes
    assert rows[3]["describe_ms"] == ""  # ORB describes its points itself
    poses = np.loadtxt(tmp_path / "trajectories/boards/sift/n100_seed1.kitti").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, result.results[1].runs[1].poses[:, :3], atol=1e-8)


def test_tables(result):
    lines = matrix(result).splitlines()
    assert [cell.strip() for cell in lines[0].strip("|").split("|")] == ["drift, % (bridged)", "n = 20", "n = 100"]
    assert len(lines) == 4
    mean, spread = result.results[1].error("drift")
    assert f" {mean:.2f} ± {spread:.2f} " in lines[2].split("|")[3]
    assert len(table(result).splitlines()) == 6
    assert "drift over 2 segments of 0.28 m" in protocol_line(result)  # half of the path
    assert "seeds 0, 1" in protocol_line(result)


def test_figures_show_every_method(result):
    drawn = figures(result)
    assert len(drawn["trajectories"].axes) == 2
    labels = {text.get_text() for text in drawn["trajectories"].axes[-1].get_legend().get_texts()}
    assert labels == {"true", "Sift", "Orb"}
    (axes,) = drawn["drift"].axes
    sift = next(line for line in axes.lines if line.get_label() == "Sift")
    np.testing.assert_array_equal(sift.get_ydata(), [one.error("drift")[0] for one in result.results[:2]])


def test_without_true_poses():
    scene = StereoScene(2, "depth")
    scene.poses = [None, None]
    blind = run_sequence(scene, METHODS[:1], Plan((20, 100), OdometrySettings(iterations=50), repeats=1))
    assert matrix(blind).startswith("| bridged frames")
    assert "drift" not in table(blind)
    assert list(figures(blind)) == ["trajectories"]
