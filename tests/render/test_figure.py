import numpy as np
from drawing_threads import in_threads

from sips_lit.render.figure import LINE_COLOURS, clean, figure_to_array, new_figure


def test_size_in_pixels_is_inches_times_150():
    array = figure_to_array(new_figure(2.0, 1.2))
    assert array.shape == (180, 300, 3)
    assert array.dtype == np.uint8
    assert np.all(array == 255)


def test_what_is_plotted_is_in_the_picture():
    figure = new_figure(2, 2)
    figure.set_layout_engine("none")  # fills the figure
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.bar([0], [1], width=1, color=LINE_COLOURS[0])
    axes.set(xlim=(-0.5, 1.5), ylim=(0, 1))
    array = figure_to_array(figure)
    expected = [int(LINE_COLOURS[0][i : i + 2], 16) for i in (1, 3, 5)]
    np.testing.assert_array_equal(array[150, 75], expected)
    np.testing.assert_array_equal(array[150, 225], [255, 255, 255])
    array[:] = 0  # a copy: the figure draws again
    np.testing.assert_array_equal(figure_to_array(figure)[150, 75], expected)


def test_clean_axes_have_a_grid_and_no_frame():
    axes = new_figure(2, 2).add_subplot()
    clean(axes)
    assert not axes.spines["top"].get_visible()
    assert not axes.spines["right"].get_visible()
    assert axes.spines["left"].get_visible()
    assert all(line.get_visible() for line in axes.get_xgridlines())


def test_line_colours_are_distinct():
    assert len(set(LINE_COLOURS)) == len(LINE_COLOURS)


def test_figures_of_threads_do_not_meet():
    def draw() -> np.ndarray:
        figure = new_figure(1.5, 1)
        figure.add_subplot().plot([0, 1], [1, 0])
        return figure_to_array(figure)

    expected = draw()
    for array in in_threads(draw):
        np.testing.assert_array_equal(array, expected)
