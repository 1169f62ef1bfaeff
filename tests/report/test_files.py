import json
import platform
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from benchmark_examples import NAMES, detector_result, pair_set, pair_table
from golden_results import golden
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import auc_of, columns_of
from sips_lit.report.files import describe_machine, log_numbers, write_report
from sips_lit.report.pair_pictures import PairPicture

VOID = {"meta", "input", "img", "br"}
MACHINE = {"processor": "a test", "cores": "2"}


class Page(HTMLParser):
    """Checks that tags nest, and collects ids, links and tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.tags, self.ids, self.links = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes, ends=True)

    def handle_starttag(self, tag, attributes, ends=False):
        self.tags.append(tag)
        values = dict(attributes)
        self.ids += [values["id"]] if "id" in values else []
        self.links += [v for k, v in attributes if k in ("src", "href", "xlink:href")]
        if tag not in VOID and not ends:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "new"
    result = pair_set(NAMES[:2], 12, repeats=2)
    cv2.imwrite(str(folder.parent / "best.png"), np.full((40, 60, 3), 90, np.uint8))
    drawn = [
        PairPicture("best", folder.parent / "best.png", "n_10 = 12"),
        PairPicture("worst", np.zeros((30, 1200, 3), np.uint8), "never"),
    ]
    written = write_report(folder, [result], {("kitti", "sift"): drawn}, "a day in May", MACHINE)
    return folder, result, written, (folder / "report.html").read_text()


def test_all_files_are_there(report):
    folder, result, written, _ = report
    assert all(path.exists() for path in written)
    names = {path.relative_to(folder).as_posix() for path in written}
    for key in (
        "succinctness",
        "auc_by_k",
        "translation_error",
        "rotation_auc_by_k",
        "calibration_500",
        "pose_difference",
    ):
        assert {f"figures/kitti_{key}.png", f"figures/kitti_{key}.svg"} <= names
    assert {
        "report.html",
        "results.json",
        "summary.csv",
        "kitti/sift_pairs.csv",
        "pictures/kitti/sift_worst.png",
    } <= names
    assert cv2.imread(str(folder / "figures" / "kitti_succinctness.png")).std() > 5
    assert len(json.loads((folder / "results.json").read_text())["pair_sets"][0]["detectors"]) == len(result.detectors)


def test_the_page_needs_nothing_else(report):
    *_, text = report
    page = Page(text)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"@import|url\((?!#)", text)
    assert page.tags.count("img") == 2
    assert page.tags.count("script") == 1


def test_the_page_says_it_all(report):
    _, result, _, text = report
    for detector in result.detectors:
        assert f">{detector.name}" in text
        assert f"{auc_of(detector):.3f}" in text
    for words in (
        "a day in May",
        "a test",
        "superpoint.pth is missing",
        "Definitions",
        "stereo_p3p",
        "3000",
        "control",
    ):
        assert words in text
    curves = set(re.findall(r'class="(curve-\d+)"', text))
    assert curves == {f"curve-{i}" for i in re.findall(r'data-curve="(\d+)"', text)}
    assert len(curves) == len(result.detectors)


def test_tensorboard(report):
    folder, result, *_ = report
    events = EventAccumulator(str(folder / "tensorboard")).Reload()
    assert "benchmark/kitti/succinctness" in events.Tags()["images"]
    (event,) = events.Scalars("benchmark/kitti/sift/auc")
    auc = next(auc_of(d) for d in result.detectors if d.key == "sift")
    assert event.value == pytest.approx(auc, abs=1e-6)


def test_names_are_text_and_nothing_else(tmp_path):
    evil = '<script>alert("1")</script> $x_{$ & _'
    table = replace(pair_table(np.random.default_rng(0), 3), name=(evil,) * 3)
    detector = replace(detector_result(evil, table, key="e/../v"), defects={evil: 1}, protocol={evil: {evil: evil}})
    result = PairSetResult("../" + evil, evil, {evil: evil, "verification": [{evil: evil}]}, (detector,), {evil: evil})
    pictures = {(result.key, detector.key): [PairPicture(evil, np.zeros((9, 9, 3), np.uint8), evil)]}
    written = write_report(tmp_path / "r", [result], pictures, evil, {evil: evil})
    text = (tmp_path / "r" / "report.html").read_text()
    assert Page(text).tags.count("script") == 1
    assert "<script>alert" not in text
    assert all((tmp_path / "r").resolve() in path.resolve().parents for path in written)


def nothing() -> list[PairSetResult]:
    return [PairSetResult("e", "empty", {}, (), {"sift": "no such file"})]


def all_failed() -> list[PairSetResult]:
    table = pair_table(np.random.default_rng(0), 1)
    failed = detector_result("bad", table, quality=-1e9, repeats=1)
    return [PairSetResult("f", "failed", {}, (failed, replace(failed, key="twin", budgets={}, milliseconds={})), {})]


def no_poses() -> list[PairSetResult]:
    return [pair_set(NAMES[:1], 4, poses=False)]


@pytest.mark.parametrize("results", [list, nothing, all_failed, no_poses])
def test_what_is_undefined_breaks_nothing(tmp_path, results):
    write_report(tmp_path, results(), {}, machine=MACHINE)
    text = (tmp_path / "report.html").read_text()
    Page(text)
    assert ">nan<" not in text
    if results is nothing:
        assert "no such file" in text
    if results is all_failed:
        assert "never" in text
        assert "bad (twin)" in text  # one name, two detectors
    if results is no_poses:
        assert "pose AUC-1 m" not in text


def test_the_machine_does_not_tell_whose_it_is():
    machine = describe_machine()
    assert int(machine["cores"]) >= 1
    assert machine["processor"]
    text = " ".join(machine.values())
    assert str(Path.home()) not in text
    assert not platform.node() or platform.node() not in text.split()


class Writer:
    """Keeps what it is given."""

    def __init__(self):
        self.scalars = {}

    def add_scalar(self, tag, value):
        assert tag not in self.scalars
        self.scalars[tag] = value


def test_each_number_has_its_tag():
    result, writer = golden(), Writer()
    log_numbers(writer, [result, replace(result, key="other", detectors=result.detectors[1:])])
    tags = {"/".join(tag.split("/")[1:3]) for tag in writer.scalars}
    assert tags == {"kitti/alpha", "kitti/beta", "other/beta"}
    for column in columns_of(result.detectors):
        value = column.value(result.detectors[0])
        assert writer.scalars[f"benchmark/kitti/alpha/{column.key}"] == value


def test_what_is_undefined_or_infinite_is_left_out():
    result, writer = golden(), Writer()
    failed = replace(result.detectors[0], n_k=result.detectors[0].n_k + float("inf"))
    log_numbers(writer, [replace(result, detectors=(failed, result.detectors[1]))])
    assert "benchmark/kitti/alpha/n_at_80" not in writer.scalars  # never
    assert "benchmark/kitti/beta/ece_30" not in writer.scalars  # no probabilities
    assert writer.scalars["benchmark/kitti/alpha/auc"] == 0
    log_numbers(empty := Writer(), [])
    assert empty.scalars == {}
