"""The notebooks of the documentation run, and are stored without what they print."""

import json
from typing import Any

import numpy as np
import pytest
from markdown_code import ROOT

NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))


def code_cells(path) -> list[dict[str, Any]]:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_stored_without_outputs(path):
    for cell in code_cells(path):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


def test_matching_runs_and_finds_what_is_true(tmp_path, monkeypatch, capsys):
    pytest.importorskip("skimage", reason="the stereo pair is in scikit-image: pip install 'sips_lit[demo]'")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    path = ROOT / "docs" / "notebooks" / "match.ipynb"
    for index, cell in enumerate(code_cells(path)):
        exec(compile("".join(cell["source"]), f"{path.name}, cell {index}", "exec"), names)
    assert "inliers; pose" in capsys.readouterr().out
    stereo, city = names["stereo"], names["city"]
    np.testing.assert_allclose(stereo.R, np.eye(3), atol=0.01)
    np.testing.assert_allclose(stereo.t, [-1, 0, 0], atol=0.05)
    right = names["right_ones"]
    inliers = stereo.inlier[names["known"]]
    assert right[inliers].mean() > max(
        0.7, right[~inliers].mean() + 0.2
    )  # a wrong match on the true row is an inlier, too
    assert city.inlier.sum() > 50
    assert names["after"] < names["before"] / 2
    assert len(names["keypoints"]) == 500
