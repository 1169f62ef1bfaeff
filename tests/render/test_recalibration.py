import numpy as np

from sips_lit.metrics.calibration import bin_sums, summarise
from sips_lit.metrics.coverage import coverage
from sips_lit.render.figure import figure_to_array
from sips_lit.render.recalibration import draw_recalibration

GOOD, BAD, NONE = (
    summarise(bin_sums(np.array(scores), np.array(labels)))
    for scores, labels in (([0.1, 0.9], [0, 1]), ([0.8, 0.9], [0, 1]), ([], []))
)
KEPT = [coverage(q, [2, 2], np.array([[0, 1, 2], [0, 1, 1]]), 2) for q in (0.5, 0.9)]
NEVER = [coverage(q, [None], np.array([[0, 1]]), 2) for q in (0.5, 0.9)]


def test_errors_and_promises_of_each_data_set():
    figure = draw_recalibration(
        {"desk": (BAD, GOOD), "a_$set": (BAD, BAD)}, {"desk": (KEPT, KEPT), "a_$set": (KEPT, NEVER)}
    )
    upper, lower = figure.axes[0], figure.axes[2]
    labels = [text.get_text() for text in upper.get_legend().get_texts()]
    assert labels == [f"before: ECE {BAD.ece:.3f}", f"after: ECE {GOOD.ece:.3f}"]
    assert list(lower.lines[1].get_ydata()) == [0.5, 0.5]
    assert figure.axes[1].get_title() == r"a_\$set"
    assert figure_to_array(figure).std() > 0


def test_no_points_at_all():
    assert figure_to_array(draw_recalibration({"none": (NONE, NONE)}, {"none": (NEVER, NEVER)})).size
