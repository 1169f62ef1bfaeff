import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from benchmark_examples import NAMES, pair_set
from golden_results import golden

import sips_lit.report.page as page_module
from sips_lit.evaluate.result import PairSetResult
from sips_lit.render.styles import detector_styles
from sips_lit.report.column import Column
from sips_lit.report.columns import columns_of
from sips_lit.report.counts import OUTCOMES
from sips_lit.report.intervals import intervals
from sips_lit.report.labels import styles_of
from sips_lit.report.page import differences_to_best, report_page, table_rows
from sips_lit.report.pair_pictures import PairPicture

PICTURE = PairPicture("best", np.full((9, 12, 3), 90, np.uint8), "n_7 = 12")


def page(*results, pictures=None, date="2026-01-02"):
    styles = detector_styles(method.name for result in results for method in result.detectors)
    return report_page(results, pictures or {}, styles, date, {"cores": "2", "processor": "a test"})


def one_method():
    result = golden()
    return replace(result, detectors=result.detectors[:1])


@pytest.fixture(scope="module")
def text():
    return page(golden(), pictures={("kitti", "beta"): [PICTURE]})


def entries(text):
    """The glossary: meanings by term."""
    found = re.findall(r"<dt>(.*?)</dt>\s*<dd>(.*?)</dd>", text, re.DOTALL)
    return {unescape(term): " ".join(unescape(meaning).split()) for term, meaning in found}


def test_every_column_is_defined_where_it_stands_and_in_the_glossary(text):
    glossary = entries(text)
    tips = dict(re.findall(r'title="([^"]*)"><button type="button">(.*?)</button>', text))
    for column in columns_of(golden().detectors):
        assert glossary[column.title] == column.definition
        assert {unescape(tip): unescape(title) for tip, title in tips.items()}[column.definition] == column.title


def test_every_reason_for_no_number_is_explained(text):
    assert set(OUTCOMES.values()) - {"with a pose"} <= set(entries(text))
    assert {"failure", "own n only", "control", "- (a dash)"} <= set(entries(text))


def test_definitions_of_different_pair_sets():
    """One title may mean another k."""
    other = replace(golden(), detectors=tuple(replace(m, protocol=m.protocol | {"k": 4}) for m in golden().detectors))
    glossary = page(golden(), other).split('id="glossary"')[1]
    for k in (4, 7):
        assert glossary.count(f"80 % of the pairs have {k} inliers") == 1


def test_parts_of_a_pair_set(text):
    for words in (
        "<h2>KITTI</h2>",
        "6 pairs of images. A click on a heading sorts.",
        "<b>gone</b>: no weights",
        "Best, median and worst pair of each method",
        "<b>best</b>: n_7 = 12",
        "Pairs without a pose at 60 points, each in 4 repeats",
        "What differs between the methods",
        "the same for all methods",
        '<th scope="row">overlap</th><td>0.25</td>',
        '<th scope="row">processor</th><td>a test</td>',
        '<p class="soft">2026-01-02</p>',
    ):
        assert words in text
    assert text.count("<img") == 1
    assert 'alt="best pair of Beta"' in text


def test_the_text_suits_one_method():
    text = page(one_method(), pictures={("kitti", "alpha"): [PICTURE]})
    section = text.split('<section id="set-0">')[1].split("</section>")[0]
    assert "<h3>Best, median and worst pair</h3>" in section
    assert "Defects in what the detector returned" in section
    assert "The detector was asked for" in section
    for words in ("<fieldset>", "A click on a heading", "all methods", "each method", "What differs", 'class="best"'):
        assert words not in section
    assert "enchmark" not in re.sub(r"data:image[^\"]*", "", text)


def test_curves_are_ticked_best_first():
    result = pair_set(NAMES[:4], 6, repeats=1)
    result = replace(result, detectors=result.detectors[::-1])
    fieldset = page(result).split("<fieldset>")[1].split("</fieldset>")[0]
    assert re.findall(r'data-show="(\d+)">([^<]*)', fieldset) == [("8", "all"), ("0", "none"), ("6", "best 6")]
    names = [unescape(name.strip()) for name in re.findall(r"</svg>([^<]*)</label>", fieldset)]
    assert set(names) == {method.name for method in result.detectors}
    assert names[0] == "SIPs + RootSIFT"
    assert {"random + RootSIFT", "grid + RootSIFT"} == set(names[-2:])
    styles = detector_styles(method.name for method in result.detectors)
    assert re.findall(r'data-curve="(\d+)"', fieldset) == [str(styles[name].index) for name in names]


def test_a_line_looks_as_in_the_charts(text):
    """Solid with a common descriptor, dashed with the detector's own."""
    styles = detector_styles(["Alpha + RootSIFT", "Beta"])
    for name, dashes in (("Alpha + RootSIFT", ""), ("Beta", "6 3")):
        (swatch,) = set(re.findall(rf'<svg class="swatch"[^>]*>(<path[^>]*>)</svg>{re.escape(name)}', text))
        assert f'stroke="{styles[name].colour}"' in swatch
        assert f'stroke-dasharray="{dashes}"' in swatch


def test_nothing_was_measured():
    text = page(PairSetResult("e", "empty", {}, (), {"sift": "no such file"}), date=None)
    assert "No method could be measured on this pair set." in text
    assert "<b>sift</b>: no such file" in text
    assert "No method was measured." in text
    assert "<table" not in text.split('id="glossary"')[0]
    assert "There are no pair sets." in page()


def test_every_text_is_escaped():
    evil = "<i>&\"'"
    result = one_method()
    method = replace(result.detectors[0], name=evil, protocol=result.detectors[0].protocol | {evil: evil})
    result = replace(result, title=evil, protocol={evil: evil}, detectors=(method,), skipped={evil: evil})
    text = page(result, pictures={("kitti", "alpha"): [replace(PICTURE, label=evil, caption=evil)]}, date=evil)
    assert "<i>" not in text
    assert text.count("&lt;i&gt;&amp;&#34;&#39;") > 10


def column(values, better=1, **others):
    """A column with a value for each method by name."""
    return Column("x", "X", "What it is.", 2, better, lambda method: values[method.name], **others)


def methods(*names):
    """The first golden method under other names, each better than the next."""
    first = golden().detectors[0]
    return [replace(first, name=name, n_k=first.n_k + rank) for rank, name in enumerate(names)]


def cells(values, better=1, **others):
    return {row.name: row.cells[0] for row in table_rows(methods(*values), [column(values, better, **others)])}


def test_best_auc_first():
    assert [row.name for row in table_rows(methods("a", "b", "c")[::-1], [])] == ["a", "b", "c"]


def test_what_is_shown_and_what_sorts():
    shown = cells({"a": 2.345, "b": math.inf, "c": math.nan}, better=-1)
    assert [(cell.text, cell.key) for cell in shown.values()] == [("2.35", "2.345"), ("never", "Infinity"), ("-", "")]
    assert [cell.best for cell in shown.values()] == [True, False, False]


def best(values, better=1):
    return {name for name, cell in cells(values, better).items() if cell.best}


def test_the_best_as_it_is_shown():
    assert best({"a": 0.501, "b": 0.502, "c": 0.4}) == {"a", "b"}  # both 0.50
    assert best({"a": 1.0, "b": 2.0}, better=-1) == {"a"}
    assert best({"a": 1.0, "b": 2.0}, better=0) == set()
    assert best({"a": math.inf, "b": math.inf}, better=-1) == set()


def test_a_control_is_never_the_best():
    assert best({"a": 0.3, "b": 0.2, "random + RootSIFT": 0.9}) == {"a"}
    assert best({"a": 0.3, "b": 0.2, "random + RootSIFT": 0.3}) == {"a"}
    (row,) = table_rows(methods("grid"), [])
    assert (row.control, row.tags) == (True, ("control",))


def test_one_method_has_no_rival():
    assert best({"a": 0.3}) == set()
    assert best({"a": 0.3, "random": 0.1}) == set()


def test_the_deviation_where_there_is_one():
    shown = cells({"a": 1.0, "b": 2.0}, deviation=lambda method: 0.1234 if method.name == "a" else np.nan)
    assert [cell.deviation for cell in shown.values()] == ["± 0.123", ""]


def test_points_without_an_order_are_tagged():
    (method,) = methods("LF-Net")
    (row,) = table_rows([replace(method, protocol={"scores": "none"})], [])
    assert (row.control, row.tags) == (False, ("own n only",))


@pytest.fixture(scope="module")
def compared():
    result = pair_set(NAMES[:3], 40, repeats=1)
    found = intervals(result, 200)
    return result, found, report_page([result], {}, styles_of([result]), None, {}, {result.key: found})


def test_intervals_and_marks(compared):
    result, found, text = compared
    columns = columns_of(result.detectors)
    for row in table_rows(result.detectors, columns, found):
        (method,) = [method for method in result.detectors if method.name == row.name]
        for cell, column in zip(row.cells, columns, strict=True):
            estimate = found.of.get((method.key, column.key))
            assert (cell.interval != "") == (estimate is not None and estimate.low < math.inf)
            if estimate is not None:
                assert cell.tied == (estimate.tied and not cell.best and not row.control)
    assert "Below a number: its 95 % interval, from 200 draws of the pairs." in " ".join(text.split())


def test_differences_to_the_best(compared):
    result, found, text = compared
    titles, rows = differences_to_best(result.detectors, columns_of(result.detectors), found)
    assert titles == ["n at 80 %", "AUC-200", "pose AUC-1 m at 50", "pose AUC-1° at 50"]
    assert [cells[1] for cells in rows.values()].count("best") == 1
    worse = next(method for method in result.detectors if method.name == "ORB + RootSIFT")
    estimate = found.of[worse.key, "auc"]
    apart = f"{estimate.difference:+.3f} [{estimate.difference_low:+.3f}, {estimate.difference_high:+.3f}]"
    assert rows[worse.name][1] == apart + " ≈" * estimate.tied
    assert rows["random + RootSIFT"][0] == "never"
    assert "Difference to the best, with its 95 % interval" in text
    assert apart in text


def test_without_intervals_nothing_is_said_of_them(text):
    body = text.split('<section id="glossary">')[0].split("</style>")[1]
    assert "interval" not in body
    assert "Difference to the best" not in body


def test_no_letter_is_smaller_than_11_pixels():
    """Font sizes of the style sheet for a screen, relative ones in the smallest table."""
    css = (Path(page_module.__file__).parent / "templates" / "page.css").read_text().split("@media print")[0]
    sizes = re.findall(r"font-size: ([0-9.]+)(rem|em|px)", css)
    assert len(sizes) > 10
    for size, unit in sizes:
        if unit != "px":  # letters within figures, which are scaled
            assert float(size) * (16 if unit == "rem" else 0.82 * 16) >= 11, (size, unit)
