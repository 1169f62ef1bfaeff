"""Every column of every output against numbers that are computed here, one by one, from results without equal numbers."""

import csv
import json
import math
from html.parser import HTMLParser
from statistics import median as median_of

import numpy as np
import pytest
from golden_numbers import column, deviations, middle, numbers
from golden_results import (
    BUDGETS,
    DEFECTS,
    KS,
    N_MAX,
    PAIRS,
    K,
    N,
    all_numbers,
    golden,
)
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sips_lit.evaluate.result import PoseOutcome
from sips_lit.report.files import write_report
from sips_lit.report.terminal import markdown, protocol_line

# key: title, digits, whether more (1) or less (-1) is better
COLUMNS = {
    "n_at_80": ("n at 80 %", 0, -1),
    "median_n": ("median n", 0, -1),
    "mean_n": ("mean n to 7 inliers", 1, -1),
    "auc": ("AUC-90", 3, 1),
    "failures": ("failures", 1, -1),
    "n_at_80_judged": ("n at 80 %, judged", 0, -1),
    "auc_judged": ("AUC-90, judged", 3, 1),
    "unknown": ("truth unknown", 3, 0),
    "pose_auc_0.5m": ("pose AUC-0.5 m at 60", 3, 1),
    "pose_auc_2deg": ("pose AUC-2° at 60", 3, 1),
    "no_pose": ("no pose at 60", 1, -1),
    "repeatability": ("repeatability at 60", 3, 1),
    "matching_score": ("matching score at 60", 3, 1),
    "spread": ("spread at 60", 3, 1),
    "ece_30": ("ECE at 30", 3, -1),
    "ece_80": ("ECE at 80", 3, -1),
    "points": ("points found", 1, 0),
    "detect_ms": ("detect, ms", 1, -1),
    "describe_ms": ("describe, ms", 1, -1),
    "match_ms": ("match, ms", 1, -1),
    "verify_ms": ("verify, ms", 1, -1),
}


def shown(key, value):
    """As people read it; counts that are whole have no decimals."""
    if math.isnan(value):
        return "-"
    whole = key in ("failures", "no_pose") and value == int(value)
    return "never" if value == math.inf else f"{value:.{0 if whole else COLUMNS[key][1]}f}"


def rows_of(path):
    with path.open(newline="") as handle:
        return list(csv.DictReader(handle))


def assert_cells(row, expected):
    """The cells of a row of CSV, in order: texts as they are, and numbers that read back as the expected ones."""
    assert list(row) == list(expected)
    for key, value in expected.items():
        if isinstance(value, str):
            assert row[key] == value, key
        else:
            assert float(row[key]) == pytest.approx(value, rel=1e-12, nan_ok=True), key


@pytest.fixture(scope="module")
def result():
    return golden()


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("golden")
    write_report(path, [result], {}, "a date", {"cores": "2"})
    return path


def test_no_two_numbers_are_equal(result):
    """Or the other tests would not notice an exchange."""
    everything = all_numbers(result)
    assert len(set(everything)) == len(everything) > 600
    for method in result.detectors:
        for needed in (*np.moveaxis(method.n_k, 2, 0), *np.moveaxis(method.n_k_judged, 2, 0)):
            finite = needed[np.isfinite(needed)]
            assert len(np.unique(finite)) == finite.size < needed.size
    for rows in (numbers, deviations):
        values = [x for method in result.detectors for x in rows(method).values() if not math.isnan(x)]
        assert len(set(values)) == len(values)


def test_summary_csv(result, folder):
    rows = rows_of(folder / "summary.csv")
    for row, method in zip(rows, result.detectors, strict=True):
        expected = {"pair_set": "kitti", "detector": method.key, "name": method.name}
        expected |= {"pairs": str(PAIRS), "k": str(K), "n_max": str(N_MAX), "n": str(N)}
        spread = deviations(method)
        for key, value in numbers(method).items():
            expected[key] = value
            if key in spread:
                expected[f"{key}_deviation"] = spread[key]
        assert_cells(row, expected)


def test_pairs_csv(result, folder):
    for method in result.detectors:
        rows = rows_of(folder / "kitti" / f"{method.key}_pairs.csv")
        assert len(rows) == PAIRS
        for pair, row in enumerate(rows):
            expected = {"name": method.pairs.name[pair], "dR": method.pairs.rotation[pair]}
            expected |= {"dt": method.pairs.translation[pair], "nmin": middle(method.n_k[:, :, 1], pair)}
            expected["eR"] = middle(method.rotation_error[:, :, 1], pair)
            expected["et"] = middle(method.translation_error[:, :, 1], pair)
            assert_cells(row, expected)


def test_all_csv(result, folder):
    for method in result.detectors:
        rows = rows_of(folder / "kitti" / f"{method.key}_all.csv")
        assert len(rows) == PAIRS
        for pair, row in enumerate(rows):
            expected = {key: getattr(method.pairs, key)[pair] for key in ("name", "overlap", "gap", "pixels")}
            expected |= {"dR": method.pairs.rotation[pair], "dt": method.pairs.translation[pair]}
            expected |= {"points0": method.points0[pair], "points1": method.points1[pair]}
            expected["unknown"] = method.unknown[pair]
            for at_k, k in enumerate(KS):
                expected[f"n_{k}"] = middle(method.n_k[:, :, at_k], pair)
                expected[f"n_{k}_judged"] = middle(method.n_k_judged[:, :, at_k], pair)
                expected[f"eR_{k}"] = middle(method.rotation_error[:, :, at_k], pair)
                expected[f"et_{k}"] = middle(method.translation_error[:, :, at_k], pair)
            for n in BUDGETS:
                at = method.budgets[n]
                expected[f"matches_at_{n}"] = at.matches[pair]
                expected[f"inliers_at_{n}"] = middle(at.inliers, pair)
                expected[f"eR_at_{n}"] = middle(at.rotation_error, pair)
                expected[f"et_at_{n}"] = middle(at.translation_error, pair)
                expected[f"repeatability_at_{n}"] = at.repeatability[pair]
                expected[f"matching_score_at_{n}"] = at.matching_score[pair]
                expected[f"spread_at_{n}"] = at.spread[pair]
            assert_cells(row, expected)


def in_json(value):
    """Arrays as lists, with null for NaN and a text for infinity."""
    if isinstance(value, np.ndarray | list | tuple):
        return [in_json(entry) for entry in value]
    if isinstance(value, str):
        return value
    return None if math.isnan(value) else "inf" if value == math.inf else value


def test_results_json(result, folder):
    stored = json.loads((folder / "results.json").read_text())
    assert (stored.pop("date"), stored.pop("machine")) == ("a date", {"cores": "2"})
    assert stored.pop("pictures") == []
    assert stored.pop("format") == "sips_lit benchmark 1"
    (pair_set,) = stored.pop("pair_sets")
    assert stored == {}
    methods = pair_set.pop("detectors")
    assert pair_set == {
        "key": "kitti",
        "title": "KITTI",
        "protocol": result.protocol,
        "skipped": {"gone": "no weights"},
    }
    for found, method in zip(methods, result.detectors, strict=True):
        expected = {"key": method.key, "name": method.name, "protocol": method.protocol, "n_max": N_MAX}
        expected |= {"milliseconds": method.milliseconds, "defects": method.defects, "covariance": {}}
        fields = ("ks", "n_k", "n_k_judged", "unknown", "rotation_error", "translation_error", "points0", "points1")
        for field in fields:
            expected[field] = in_json(getattr(method, field))
        pairs = ("name", "overlap", "gap", "pixels", "rotation", "translation")
        expected["pairs"] = {field: in_json(getattr(method.pairs, field)) for field in pairs}
        at = ("matches", "inliers", "rotation_error", "translation_error", "outcome")
        at = ("n", *at, "repeatability", "matching_score", "spread")
        expected["budgets"] = [{field: in_json(getattr(method.budgets[n], field)) for field in at} for n in BUDGETS]
        of = ("ece", "mce", "brier", "edges", "count", "mean_score", "frequency")
        expected["calibration"] = {
            str(n): {field: in_json(getattr(c, field)) for field in of} for n, c in method.calibration.items()
        }
        assert found == expected


def best_first(result):
    return sorted(result.detectors, key=lambda method: -numbers(method)["auc"])


def test_markdown_and_the_line_of_the_terminal(result):
    header, _, *lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in markdown(result).splitlines()
    ]
    assert header == ["method", *(title for title, *_ in COLUMNS.values())]
    expected = [[m.name, *(shown(key, numbers(m)[key]) for key in COLUMNS)] for m in best_first(result)]
    assert lines == expected
    assert protocol_line(result) == (
        "k = 7, at most 90 points, 6 pairs (overlap=0.25, seed=3), exact search, inliers=stereo_p3p, threshold=2.5"
        ", 3 frames, 24.5 px, 1.48 m, 19.3 degrees apart (median)"
    )
    pairs = result.detectors[0].pairs
    assert (f"{np.median(pairs.translation[:-1]):.3g}", f"{np.median(pairs.rotation[:-1]):.3g}") == ("1.48", "19.3")


class Tables(HTMLParser):
    """The tables of a page: rows of cells, each with its text and its attributes."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.classes, self.cell = [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "table":
            self.tables.append([])
            self.classes.append(dict(attributes).get("class"))
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.cell = dict(attributes) | {"text": ""}
            self.tables[-1][-1].append(self.cell)

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.cell = None

    def handle_data(self, data):
        if self.cell is not None:
            self.cell["text"] += data


@pytest.fixture(scope="module")
def page(folder):
    return Tables((folder / "report.html").read_text())


@pytest.fixture(scope="module")
def tables(page):
    """The table of the methods and those below it."""
    return page.tables[page.classes.index("sortable") :]


def test_the_head_of_the_page(result, page):
    known, statistics = page.tables[: page.classes.index("sortable")]
    assert [[cell["text"] for cell in row] for row in known] == [
        ["sequence", "drive"],
        ["pairs", f"{PAIRS}, of overlap 0.25 or more, drawn with seed 3"],
    ]
    pairs = result.detectors[0].pairs
    for (title, *cells), values in zip(
        statistics[1:], (pairs.overlap, pairs.gap, pairs.pixels, pairs.translation, pairs.rotation), strict=True
    ):
        ordered = sorted(x for x in values.tolist() if not math.isnan(x))
        least, _, median, _, most = (float(cell["text"]) for cell in cells)
        expected = ordered[0], median_of(ordered), ordered[-1]
        assert (least, median, most) == pytest.approx(expected, rel=5e-3), title["text"]


def test_table_of_the_page(result, tables):
    heads, *rows = tables[0]
    assert [head["text"] for head in heads] == ["method", *(title for title, *_ in COLUMNS.values())]
    for row, method in zip(rows, best_first(result), strict=True):
        name, *cells = row
        assert (name["text"], name["data-value"]) == (method.name, method.name)
        spread = deviations(method)
        for cell, (key, value) in zip(cells, numbers(method).items(), strict=True):
            text = shown(key, value) + (f" ± {spread[key]:.3f}" if key in spread else "")
            assert cell["text"] == text, key
            sorted_by = float(cell["data-value"]) if cell["data-value"] else math.nan
            assert sorted_by == pytest.approx(value, rel=1e-12, nan_ok=True), key


def test_the_best_are_marked(result, tables):
    for at, (key, (_, _, better)) in enumerate(COLUMNS.items(), 1):
        values = [numbers(method)[key] for method in best_first(result)]
        known = [value for value in values if not math.isnan(value)]
        best = {1: max(known), -1: min(known), 0: None}[better] if len(known) > 1 else None  # one has no rival
        marked = [row[at].get("class") == "best" for row in tables[0][1:]]
        assert marked == [value == best and value < math.inf for value in values], key
        assert tables[0][0][at]["data-first"] == ("descending" if better > 0 else "ascending")


def test_counts_of_the_page(result, tables):
    kinds = {
        "with a pose": PoseOutcome.FOUND,
        "fewer than 4 correspondences": PoseOutcome.FEW_MATCHES,
        "RANSAC finds nothing": PoseOutcome.NO_AGREEMENT,
        "a pose of few inliers": PoseOutcome.FEW_INLIERS,
        "truth or depth unknown": PoseOutcome.UNKNOWN,
    }
    expected = [
        ["method", *DEFECTS],
        *([m.name, *(str(m.defects[kind]) for kind in DEFECTS)] for m in result.detectors),
    ]
    assert [[cell["text"] for cell in row] for row in tables[1]] == expected
    counted = [
        [m.name, *(str(column(m.budgets[N].outcome).count(kind)) for kind in kinds.values())] for m in result.detectors
    ]
    assert [[cell["text"] for cell in row] for row in tables[2]] == [["method", *kinds], *counted]


def test_tensorboard(result, folder):
    events = EventAccumulator(str(folder / "tensorboard")).Reload()
    logged = {tag: events.Scalars(tag) for tag in events.Tags()["scalars"]}
    expected = {
        f"benchmark/kitti/{method.key}/{key}": value
        for method in result.detectors
        for key, value in numbers(method).items()
        if math.isfinite(value)
    }
    assert set(logged) == set(expected)
    for tag, value in expected.items():
        (event,) = logged[tag]
        assert event.value == pytest.approx(value, rel=1e-6), tag
