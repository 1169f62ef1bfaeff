import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.evaluate.evaluation import Evaluation, evaluate
from sips_lit.evaluate.pairs import PairSet, draw_pairs
from sips_lit.evaluate.pictures import write_match_pictures
from sips_lit.evaluate.results import as_plain, protocol_line, table, write_results
from sips_lit.inliers.homography import HomographyInliers

K, N_MAX = 8, 60


@pytest.fixture(scope="module")
def pairs(tmp_path_factory) -> PairSet:
    return draw_pairs([flight(8, size=(128, 96))], HomographyInliers(), tmp_path_factory.mktemp("i"), 5, 0.5)


@pytest.fixture(scope="module")
def sips() -> SipsDetector:
    torch.manual_seed(0)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


@pytest.fixture(scope="module")
def corners(pairs) -> Evaluation:
    return evaluate(ShiTomasi(), RootSift(), pairs, K, N_MAX)


@pytest.fixture(scope="module")
def learned(pairs, sips) -> Evaluation:
    return evaluate(sips, RootSift(), pairs, K, N_MAX)


@pytest.fixture(scope="module")
def nothing(tmp_path_factory) -> tuple[Evaluation, PairSet]:
    """An evaluation in which every pair failed."""
    grey = ArraySequence([np.full((60, 70), 90, np.uint8)] * 4, "grey", [np.eye(3)] * 4)
    pairs = draw_pairs([grey], HomographyInliers(), tmp_path_factory.mktemp("i"), 3, 0.5)
    return evaluate(ShiTomasi(), RootSift(), pairs, K, N_MAX), pairs


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_table_has_a_row_a_detector_best_first(corners, learned, nothing):
    lines = table([nothing[0], learned, corners]).splitlines()
    assert cells(lines[0]) == ["detector", "n at 80 %", "median n", "AUC-60", "failures of 3", "ECE"]
    rows = [cells(line) for line in lines[2:]]
    assert [float(row[3]) for row in rows] == sorted((float(row[3]) for row in rows), reverse=True)
    by_name = {row[0]: row for row in rows}
    assert by_name[learned.name][5] == f"{learned.calibration.ece:.3f}"
    assert by_name[learned.name][3] == f"{learned.succinctness.auc:.3f}"
    assert rows[-1][1:] == ["never", "never", "0.000", "3", ""]


def test_the_protocol_in_a_line(corners):
    line = protocol_line(corners)
    for part in ("k = 8", "5 pairs of overlap >= 0.5 (seed 0)", "exact search", "inliers=homography", "threshold=3.0"):
        assert part in line
    assert "\n" not in line


def test_details_within_details_stay_out_of_the_line(corners):
    nested = {**corners.protocol, "verification": [{"inliers": "stereo_p3p", "stereo": {"max_disparity": 192}}]}
    line = protocol_line(replace(corners, protocol=nested))
    assert line.endswith("inliers=stereo_p3p")


def test_files(tmp_path, corners, learned):
    written = write_results(tmp_path / "new", {"corners": corners, "sips": learned})
    assert sorted(path.name for path in written) == [
        "corners_pairs.csv",
        "curves.png",
        "results.json",
        "sips_pairs.csv",
        "sips_reliability.png",
    ]
    assert all(path.stat().st_size for path in written)
    stored = json.loads((tmp_path / "new" / "results.json").read_text())
    assert set(stored) == {"corners", "sips"}
    assert stored["sips"]["protocol"] == learned.protocol
    assert stored["sips"]["succinctness"]["auc"] == learned.succinctness.auc
    assert stored["sips"]["succinctness"]["curve"] == learned.succinctness.curve.tolist()
    assert stored["corners"]["calibration"] is None
    for picture in ("curves.png", "sips_reliability.png"):
        assert cv2.imread(str(tmp_path / "new" / picture)).std() > 1
    with (tmp_path / "new" / "corners_pairs.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["pair"] for row in rows] == [row.pair for row in corners.rows]
    assert [row["inliers"] for row in rows] == [str(row.inliers) for row in corners.rows]


def test_json_has_no_nan(nothing, learned):
    for evaluation in (nothing[0], learned):
        json.loads(json.dumps(as_plain(evaluation), allow_nan=False))
    empty_bins = np.isnan(learned.calibration.frequency)
    assert empty_bins.any()
    assert [v is None for v in as_plain(learned)["calibration"]["frequency"]] == empty_bins.tolist()


def test_json_of_a_detector_without_points_has_no_nan(nothing, sips):
    class Nothing(SipsDetector):
        def detect(self, image, n):
            return super().detect(image, 0)

    evaluation = evaluate(Nothing(sips.network, sips.selector), RootSift(), nothing[1], K, N_MAX)
    assert np.isnan(evaluation.calibration.ece)
    json.loads(json.dumps(as_plain(evaluation), allow_nan=False))


def test_failures_are_empty_cells(tmp_path, nothing):
    write_results(tmp_path, {"none": nothing[0]})
    with (tmp_path / "none_pairs.csv").open() as handle:
        assert [row["n_k"] for row in csv.DictReader(handle)] == [""] * 3


def test_pictures_of_best_median_and_worst(tmp_path, pairs, learned, sips):
    written = write_match_pictures(tmp_path / "p", "pair", learned, pairs, sips, RootSift(), 20)
    assert [path.name for path in written] == ["pair_best.png", "pair_median.png", "pair_worst.png"]
    for path in written:
        picture = cv2.imread(str(path))
        assert picture.shape[1] >= 2 * 128
        assert picture.std() > 10


def test_pictures_show_the_right_pairs(tmp_path, pairs, corners, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "sips_lit.evaluate.pictures.draw_matches",
        lambda image0, *rest: drawn.append(image0.tobytes()) or np.zeros((4, 4, 3), np.uint8),
    )
    write_match_pictures(tmp_path, "pair", corners, pairs, ShiTomasi(), RootSift(), 20)
    needed = [N_MAX + 1 if row.n_k is None else row.n_k for row in corners.rows]
    images = [pair.image0.tobytes() for pair, _ in pairs]
    by_image = [[n for n, image in zip(needed, images, strict=True) if image == seen] for seen in drawn]
    assert min(needed) in by_image[0]
    assert sorted(needed)[len(needed) // 2] in by_image[1]
    assert max(needed) in by_image[2]


def test_pictures_without_any_point(tmp_path, nothing):
    evaluation, pairs = nothing
    assert len(write_match_pictures(tmp_path, "pair", evaluation, pairs, ShiTomasi(), RootSift(), 20)) == 3
