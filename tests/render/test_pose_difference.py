import numpy as np

from sips_lit.render.figure import figure_to_array
from sips_lit.render.pose_difference import draw_pose_differences

NEEDED = np.array([12, 49, 50, 100, 101, np.inf, 20.0])
WHERE = np.array([1, 2, 3, 4, 5, 6, np.nan])


def marks(axes):
    """(x, y) of the marks of each band that have a place."""
    bands = {c.get_label(): np.ma.filled(c.get_offsets(), np.nan) for c in axes.collections}
    return {label: xy[~np.isnan(xy[:, 0])].tolist() for label, xy in bands.items()}


def test_pairs_are_in_the_band_of_their_points():
    figure = draw_pose_differences({"a": NEEDED, "b": NEEDED[::-1]}, WHERE, WHERE * 2)
    assert marks(figure.axes[0]) == {
        "n < 50": [[1, 2], [2, 4]], "50 to 100": [[3, 6], [4, 8]], "> 100": [[5, 10]], "failed": [[6, 12]],
    }  # fmt: skip
    assert marks(figure.axes[1])["failed"] == [[2, 4]]
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["a", "b"]
    assert figure.get_supxlabel() == "true translation, m"
    assert figure.get_supylabel() == "true rotation, degrees"
    figure_to_array(figure)


def test_bands_differ_in_shape_and_are_named_once():
    figure = draw_pose_differences({"a": NEEDED, "b": NEEDED}, WHERE, WHERE)
    shapes = [band.get_paths()[0].vertices.tobytes() for band in figure.axes[0].collections]
    assert len(set(shapes)) == 4
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["n < 50", "50 to 100", "> 100", "failed"]


def test_a_panel_for_each_of_many_detectors():
    figure = draw_pose_differences({f"d{i}": NEEDED for i in range(6)}, WHERE, WHERE)
    assert sum(axes.axison for axes in figure.axes) == 6
    assert len(figure.axes) == 8  # two rows of four


def test_nothing_to_draw():
    figure_to_array(draw_pose_differences({}, WHERE, WHERE))
    none = np.zeros(0)
    figure_to_array(draw_pose_differences({"a": none}, none, none))
