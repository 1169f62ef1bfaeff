import math
from dataclasses import replace

import numpy as np
from golden_results import golden

from sips_lit.report.columns import Column
from sips_lit.report.sortable_table import table_rows


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
