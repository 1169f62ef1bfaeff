import json
from dataclasses import fields, is_dataclass, replace

import cv2
import numpy as np
import pytest
from benchmark_examples import NAMES, pair_set
from golden_results import golden

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult
from sips_lit.metrics.covariance import CovarianceReliability
from sips_lit.report.files import write_report
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.restored import restore_results
from sips_lit.report.stored import store_results


def assert_same(found, expected, where="result"):
    """Records alike to the last number, kinds of arrays included."""
    if is_dataclass(expected):
        assert type(found) is type(expected), where
        for field in fields(expected):
            assert_same(getattr(found, field.name), getattr(expected, field.name), f"{where}.{field.name}")
    elif isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype, where
        np.testing.assert_array_equal(found, expected, err_msg=where)
    elif isinstance(expected, dict):
        assert list(found) == list(expected), where
        for key in expected:
            assert_same(found[key], expected[key], f"{where}[{key}]")
    elif isinstance(expected, tuple):
        assert len(found) == len(expected), where
        for index, one in enumerate(expected):
            assert_same(found[index], one, f"{where}[{index}]")
    else:
        assert found == expected or (found != found and expected != expected), where


def with_covariance(result: PairSetResult) -> PairSetResult:
    reliability = CovarianceReliability(0.1, 1.5, float("nan"), np.linspace(0, 1, 4), np.array([3, 4, 5]))
    first, *others = result.detectors
    return replace(result, detectors=(replace(first, covariance={50: reliability}), *others))


def test_what_was_stored_comes_back(tmp_path):
    results = (
        with_covariance(golden()),
        pair_set(NAMES[:2], 5, poses=False),
        PairSetResult("e", "none", {}, (), {"a": "b"}),
    )
    store_results(tmp_path / "results.json", results, "a date", {"cores": "2"})
    found = restore_results(tmp_path / "results.json")
    assert (found.date, found.machine, found.pictures) == ("a date", {"cores": "2"}, {})
    assert_same(found.results, results)
    assert restore_results(tmp_path).path == tmp_path / "results.json"  # a folder stands for its file


def test_the_same_tables_are_drawn_again(tmp_path):
    picture = PairPicture("best", np.full((20, 30, 3), 90, np.uint8), "n_10 = 12")
    write_report(tmp_path / "one", [golden()], {("kitti", "alpha"): [picture]}, "a date", {"cores": "2"})
    stored = restore_results(tmp_path / "one")
    (drawn,) = stored.pictures["kitti", "alpha"]
    assert (drawn.label, drawn.caption) == ("best", "n_10 = 12")
    for folder in ("two", "one"):  # also where it was
        write_report(tmp_path / folder, stored.results, stored.pictures, stored.date, stored.machine)
    for name in ("report.html", "summary.csv", "results.json", "kitti/alpha_all.csv", "figures/kitti_succinctness.png"):
        one, two = ((tmp_path / folder / name).read_bytes() for folder in ("one", "two"))
        assert one == two, name
    copied = cv2.imread(str(tmp_path / "two" / "pictures" / "kitti" / "alpha_best.png"))
    np.testing.assert_array_equal(copied, picture.image)
    (tmp_path / "two" / "pictures" / "kitti" / "alpha_best.png").unlink()
    assert restore_results(tmp_path / "two").pictures == {}  # a page can do without


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{", "is damaged or no results of an evaluation: give its results.json"),
        ("[]", "holds no results of an evaluation"),
        ('{"format": "other"}', "holds no results of an evaluation"),
    ],
)
def test_what_is_no_result(tmp_path, content, sentence):
    (tmp_path / "x.json").write_text(content)
    with pytest.raises(BadInputError, match=sentence):
        restore_results(tmp_path / "x.json")


def test_no_file(tmp_path):
    with pytest.raises(BadInputError, match=r"the results .*gone\.json can't be read: No such file"):
        restore_results(tmp_path / "gone.json")


def test_results_of_other_versions(tmp_path):
    path = tmp_path / "results.json"
    store_results(path, [golden()])
    content = json.loads(path.read_text())
    method = content["pair_sets"][0]["detectors"][0]
    del method["covariance"]  # earlier ones did not have it, and that says nothing
    path.write_text(json.dumps(content))
    assert restore_results(path).results[0].detectors[0].covariance == {}
    del method["n_k_judged"]
    path.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"lacks n_k_judged, as another version of sips_lit wrote it"):
        restore_results(path)
    method["n_k_judged"] = "text"
    path.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="is damaged"):
        restore_results(path)
