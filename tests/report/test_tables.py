import csv

import numpy as np
from benchmark_examples import NAMES, pair_set

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import auc_of
from sips_lit.report.intervals import intervals
from sips_lit.report.summary import median_needed
from sips_lit.report.tables import summary_rows, write_tables


def test_files(tmp_path):
    result = pair_set(NAMES[:2], 6)
    other = pair_set(NAMES[:1], 4, poses=False, key="../klt", repeats=1)
    written = write_tables(tmp_path / "new", [result, other]) if (tmp_path / "new").mkdir() is None else []
    assert all(path.is_file() and (tmp_path / "new") in path.parents for path in written)
    assert len(written) == 2 + 2 * (len(result.detectors) + len(other.detectors))

    with written[0].open() as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == len(result.detectors) + len(other.detectors)
    for row, detector in zip(rows, result.detectors, strict=False):
        assert row["detector"] == detector.key
        assert float(row["auc"]) == auc_of(detector)
    assert rows[-1]["pose_auc_1m"] == ""


def test_the_papers_columns_read_back(tmp_path):
    result = pair_set(NAMES[:1], 9)
    control = result.detectors[-1]
    path = next(p for p in write_tables(tmp_path, [result]) if p.name == f"{control.key}_pairs.csv")
    assert path.read_text().splitlines()[0] == "name,dR,dt,nmin,eR,et"
    numbers = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(1, 2, 3, 4, 5))
    np.testing.assert_array_equal(numbers[:, 0], control.pairs.rotation)
    np.testing.assert_array_equal(numbers[:, 2], median_needed(control, 10))
    assert np.isinf(numbers[:, 2]).any()
    assert np.isinf(numbers[np.isinf(numbers[:, 2])][:, 3:]).all()


def test_every_k_and_budget(tmp_path):
    result = pair_set(NAMES[:1], 3)
    detector = result.detectors[0]
    with next(p for p in write_tables(tmp_path, [result]) if p.name == f"{detector.key}_all.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["name"] for row in rows] == list(detector.pairs.name)
    for k in detector.ks:
        assert [float(row[f"n_{k}"]) for row in rows] == median_needed(detector, k).tolist()
    assert [float(row["matches_at_50"]) for row in rows] == detector.budgets[50].matches.tolist()


def test_no_detectors(tmp_path):
    path, text = write_tables(tmp_path, [PairSetResult("e", "empty", {}, (), {})])
    assert len(path.read_text().splitlines()) == 1
    assert "## empty" in text.read_text()


def test_intervals_stand_beside_their_numbers():
    result = pair_set(NAMES[:2], 20, repeats=1)
    found = intervals(result, 50)
    header, *rows = summary_rows([result], {result.key: found})
    assert "auc_difference_high" in header
    for row, method in zip(rows, result.detectors, strict=True):
        cells = dict(zip(header, row, strict=True))
        estimate = found.of[method.key, "auc"]
        assert (cells["auc_low"], cells["auc_high"]) == (estimate.low, estimate.high)
        assert cells["auc_low"] <= cells["auc"] <= cells["auc_high"]
