from dataclasses import replace

import numpy as np
import pytest
from golden_numbers import area, column, curve, pose_area
from golden_results import DEGREES, KS, METRES, N_MAX, K, N, golden

from sips_lit.render.styles import detector_styles
from sips_lit.report.figures import charts


def charts_of(result, legend=True):
    styles = detector_styles(method.name for method in result.detectors)
    return {chart.key: chart for chart in charts(result, styles, legend)}


@pytest.fixture(scope="module")
def result():
    return golden()


@pytest.fixture(scope="module")
def drawn(result):
    return charts_of(result)


def lines(chart, axes=0):
    """x and y of each method's line, by the number of its style: the order of the methods."""
    found = {line.get_gid(): line.get_data() for line in chart.figure.axes[axes].lines if line.get_gid()}
    return {int(gid.removeprefix("curve-")): data for gid, data in found.items()}


def labels(chart):
    return [text.get_text() for text in chart.figure.axes[0].get_legend().get_texts()]


def test_all_charts_with_what_they_show(drawn):
    titles = {key: chart.title for key, chart in drawn.items()}
    assert titles == {
        "succinctness": "Succinctness, k = 7",
        "auc_by_k": "AUC-90 against k",
        "translation_auc_by_k": "Translation AUC against k",
        "translation_error": "Translation error at 60 points",
        "rotation_auc_by_k": "Rotation AUC against k",
        "rotation_error": "Rotation error at 60 points",
        "calibration_30": "Calibration at 30 points",
        "calibration_80": "Calibration at 80 points",
        "pose_difference": "True pose difference",
    }
    assert [key for key, chart in drawn.items() if chart.wide] == ["pose_difference"]
    assert "7 inliers" in drawn["succinctness"].caption
    assert "60 best points" in drawn["rotation_error"].caption
    assert "30 best points" in drawn["calibration_30"].caption


def test_succinctness(result, drawn):
    found = lines(drawn["succinctness"])
    for index, method in enumerate(result.detectors):
        needed = column(method.n_k[:, :, KS.index(K)])
        np.testing.assert_array_equal(found[index][0], np.arange(N_MAX + 1))
        np.testing.assert_allclose(found[index][1], [curve(needed, n) for n in range(N_MAX + 1)], atol=1e-12)
    aucs = {m.name: area(column(m.n_k[:, :, KS.index(K)])) for m in result.detectors}
    best_first = sorted(aucs, key=lambda name: -aucs[name])
    assert labels(drawn["succinctness"]) == [f"{name}  {aucs[name]:.3f}" for name in best_first]


def test_auc_by_k(result, drawn):
    found = lines(drawn["auc_by_k"])
    for index, method in enumerate(result.detectors):
        assert found[index][0].tolist() == list(KS)
        np.testing.assert_allclose(found[index][1], [area(column(method.n_k[:, :, at])) for at in range(len(KS))])


@pytest.mark.parametrize(("error", "limit"), [("translation", METRES), ("rotation", DEGREES)])
def test_pose_errors(result, drawn, error, limit):
    by_k, at_n = lines(drawn[f"{error}_auc_by_k"]), lines(drawn[f"{error}_error"])
    for index, method in enumerate(result.detectors):
        errors = getattr(method, f"{error}_error")
        expected = [pose_area(column(errors[:, :, at]), limit) for at in range(len(KS))]
        np.testing.assert_allclose(by_k[index][1], expected)
        at_budget = getattr(method.budgets[N], f"{error}_error")
        known = np.sort(at_budget[~np.isnan(at_budget)])
        x, y = at_n[index]
        assert (x[0], x[-1]) == (0, limit)
        np.testing.assert_array_equal(x[1:-1], known[known <= limit])
        for at, fraction in zip(x[1:], y[1:], strict=True):
            assert fraction == pytest.approx((known <= at).mean())


def test_only_probabilities_are_calibrated(result, drawn):
    for n in (30, 80):
        found, calibration = lines(drawn[f"calibration_{n}"]), result.detectors[0].calibration[n]
        assert set(found) == {0}
        np.testing.assert_array_equal(found[0][0], calibration.mean_score)
        np.testing.assert_array_equal(found[0][1], calibration.frequency)


def test_pose_differences(result, drawn):
    figure = drawn["pose_difference"].figure
    needed = {m.name: np.sort(m.n_k[:, :, KS.index(K)], axis=1)[:, 1] for m in result.detectors}  # the better middle
    for axes in figure.axes:
        of_method = needed[axes.get_title(loc="left")]
        fewer = axes.collections[0].get_offsets()  # of the pairs that took less than 50 points
        chosen = (of_method < 50) & ~np.isnan(result.detectors[0].pairs.rotation)
        table = result.detectors[0].pairs
        expected = np.stack([table.translation, table.rotation], 1)[chosen]
        np.testing.assert_array_equal(np.asarray(fewer)[~np.isnan(np.asarray(fewer)).any(axis=1)], expected)


def test_charts_without_numbers_are_left_out(result):
    one_k = tuple(
        replace(
            m, ks=(K,), n_k=m.n_k[:, :, 1:2], rotation_error=m.rotation_error[:, :, 1:2], calibration={}, budgets={}
        )
        for m in result.detectors
    )
    assert set(charts_of(replace(result, detectors=one_k))) == {"succinctness", "pose_difference"}
    unknown = np.full(len(result.detectors[0].pairs), np.nan)
    table = replace(result.detectors[0].pairs, rotation=unknown, translation=unknown)
    assert set(charts_of(replace(result, detectors=tuple(replace(m, pairs=table) for m in one_k)))) == {"succinctness"}
    assert charts_of(replace(result, detectors=())) == {}


def test_a_page_has_its_own_legend(result):
    assert charts_of(result, legend=False)["succinctness"].figure.axes[0].get_legend() is None
