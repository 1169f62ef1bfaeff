import numpy as np
import pytest
from drawing_threads import in_threads
from textured_scenes import keypoints

from sips_lit.render.canvas import probability_colours
from sips_lit.render.matches import COLOURS, draw_matches
from sips_lit.render.points import RADIUS
from sips_lit.types import Inliers, Keypoints, Matches, Reason

GREY, GAP, REACH = 60, 6, int(RADIUS)
WIDTH, HEIGHT = 120, 90
LEFT1 = WIDTH + GAP


def image(height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    return np.full((height, width), GREY, np.uint8)


def judged(count0: int, count1: int, pairs: list[tuple[int, int, Reason]]) -> tuple[Matches, Inliers]:
    """Matches with their reasons; the truth about all points is known."""
    index0, index1, reason = (np.array(column, np.int64) for column in zip(*pairs, strict=True)) if pairs else [[]] * 3
    matches = Matches(np.array(index0, np.int64), np.array(index1, np.int64))
    reasons = np.array(reason, np.uint8)
    known = np.ones(count0, bool), np.ones(count1, bool)
    return matches, Inliers(reasons == Reason.INLIER, reasons, *known)


def sure(xy: list[list[float]]) -> Keypoints:
    return keypoints(xy, np.ones(len(xy)))


# inlier, far, lost and unmatched, each in a row of its own
POINTS0 = sure([[20, 15], [20, 35], [20, 55], [20, 75]])
POINTS1 = sure([[90, 15], [90, 35], [90, 55], [90, 75]])
MATCHES, INLIERS = judged(4, 4, [(0, 0, Reason.INLIER), (1, 1, Reason.FAR), (2, 2, Reason.LOST)])
REASONS = [Reason.INLIER, Reason.FAR, Reason.LOST, Reason.UNMATCHED]


def drawn(**maps: np.ndarray) -> np.ndarray:
    return draw_matches(image(), image(), POINTS0, POINTS1, MATCHES, INLIERS, **maps)


def test_both_images_side_by_side_and_a_caption():
    picture = drawn()
    assert picture.dtype == np.uint8
    assert picture.shape[1:] == (2 * WIDTH + GAP, 3)
    assert picture.shape[0] > HEIGHT + GAP + 20
    assert np.all(picture[2, 2] == GREY)
    assert np.all(picture[2, LEFT1 + 2] == GREY)
    assert np.ptp(picture[HEIGHT + GAP :]) > 100  # there is text


@pytest.mark.parametrize("row", range(4))
@pytest.mark.parametrize("side", [0, 1])
def test_a_point_has_the_colour_of_its_reason(row, side):
    picture = drawn()
    x, y = (20, 15 + 20 * row) if side == 0 else (LEFT1 + 90, 15 + 20 * row)
    # beside the point on the far side of the line
    assert tuple(picture[y, x - REACH if side == 0 else x + REACH]) == COLOURS[REASONS[row]]


def test_a_point_of_unknown_truth():
    matches, inliers = judged(1, 1, [])
    unknown = Inliers(inliers.inlier, inliers.reason, np.zeros(1, bool), np.ones(1, bool))
    picture = draw_matches(image(), image(), sure([[30, 30]]), sure([[30, 30]]), matches, unknown)
    assert tuple(picture[30, 30 + REACH]) == COLOURS[Reason.UNKNOWN]
    assert tuple(picture[30, LEFT1 + 30 + REACH]) == COLOURS[Reason.UNMATCHED]


def test_lines_join_inliers_only():
    picture = drawn()
    middle = picture[:HEIGHT, 60:80].astype(int)
    assert np.all(middle[15] != GREY)
    assert np.all(middle[15].argmax(axis=1) == 1)  # green
    middle[12:19] = GREY
    assert np.all(middle == GREY)
    across_the_gap = picture[:HEIGHT, WIDTH : WIDTH + GAP]
    assert set(np.flatnonzero(np.any(across_the_gap != across_the_gap[0, 0], axis=(1, 2)))) <= set(range(12, 19))


def test_matches_join_the_points_that_they_name():
    matches, inliers = judged(3, 3, [(2, 0, Reason.INLIER)])
    points0, points1 = sure([[20, 10], [20, 30], [20, 80]]), sure([[90, 10], [90, 30], [90, 80]])
    picture = draw_matches(image(), image(), points0, points1, matches, inliers).astype(int)
    # from (20, 80) to (LEFT1 + 90, 10): halfway, at y = 45
    x = (20 + LEFT1 + 90) // 2 - 8
    y = round(80 - 70 * (x - 20) / (LEFT1 + 70))
    assert np.any(picture[y - 1 : y + 2, x] != GREY)
    assert np.all(picture[10, 40:100] == GREY)
    assert tuple(picture[80, 20 - REACH]) == COLOURS[Reason.INLIER]
    assert tuple(picture[10, 20 - REACH]) == COLOURS[Reason.UNMATCHED]
    assert tuple(picture[10, LEFT1 + 90 + REACH]) == COLOURS[Reason.INLIER]
    assert tuple(picture[80, LEFT1 + 90 + REACH]) == COLOURS[Reason.UNMATCHED]


def test_lines_end_at_their_points():
    matches, inliers = judged(1, 1, [(0, 0, Reason.INLIER)])
    last = WIDTH - 1
    for start, end in ((5, 85), (85, 5)):  # steep, so that the line's middle tells where its ends are
        picture = draw_matches(image(), image(), sure([[last, start]]), sure([[0, end]]), matches, inliers)
        ink = picture[45, WIDTH:LEFT1, 1].astype(float) - picture[0, WIDTH, 1]
        assert ink @ np.arange(WIDTH, LEFT1) / ink.sum() == pytest.approx((last + LEFT1) / 2, abs=0.3)


def test_score_maps_lie_beneath():
    low, high = np.full((HEIGHT, WIDTH), 0.1, np.float32), np.full((HEIGHT, WIDTH), 0.9, np.float32)
    picture = drawn(score_map0=low, score_map1=high)
    assert picture.shape[0] > 2 * (HEIGHT + GAP) + 20
    top = HEIGHT + GAP
    np.testing.assert_array_equal(picture[top + 2, 60], probability_colours(np.array(0.1)))
    np.testing.assert_array_equal(picture[top + 2, LEFT1 + 60], probability_colours(np.array(0.9)))
    assert tuple(picture[top + 15, 20 - REACH]) == COLOURS[Reason.INLIER]
    np.testing.assert_array_equal(picture[top + 15, 70], probability_colours(np.array(0.1)))  # no line here


@pytest.mark.parametrize("missing", [0, 1])
def test_one_score_map_alone(missing):
    scores = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    picture = drawn(**{f"score_map{1 - missing}": scores})
    there, away = (LEFT1 + 60, 60) if missing == 0 else (60, LEFT1 + 60)
    np.testing.assert_array_equal(picture[HEIGHT + GAP + 2, there], probability_colours(np.array(0.5)))
    assert picture[HEIGHT + GAP + 2, away].max() < 40


def test_images_of_different_sizes():
    matches, inliers = judged(1, 1, [(0, 0, Reason.INLIER)])
    scores0, scores1 = np.zeros((50, 200)), np.ones((110, 70))
    picture = draw_matches(
        image(50, 200), image(110, 70), sure([[100, 25]]), sure([[35, 100]]), matches, inliers, scores0, scores1
    )
    assert picture.shape[0] > 2 * (110 + GAP)
    assert picture.shape[1] == 200 + GAP + 70
    assert np.all(picture[49, 199] == GREY)
    assert np.all(picture[80, 100] < GREY)  # beneath the smaller image
    assert tuple(picture[100, 206 + 35 + REACH]) == COLOURS[Reason.INLIER]


def test_nothing_to_draw():
    matches, inliers = judged(0, 0, [])
    picture = draw_matches(image(), image(), Keypoints.empty(), Keypoints.empty(), matches, inliers)
    assert np.all(picture[:HEIGHT, :WIDTH] == GREY)
    assert np.all(picture[:HEIGHT, LEFT1:] == GREY)


def test_points_without_matches_and_in_one_image_only():
    matches, inliers = judged(2, 0, [])
    picture = draw_matches(image(), image(), sure([[30, 30], [80, 60]]), Keypoints.empty(), matches, inliers)
    assert tuple(picture[30, 30 + REACH]) == COLOURS[Reason.UNMATCHED]
    assert np.all(picture[:HEIGHT, LEFT1:] == GREY)


def test_images_of_one_pixel_and_points_on_the_border():
    matches, inliers = judged(2, 2, [(0, 0, Reason.INLIER), (1, 1, Reason.FAR)])
    points = sure([[0, 0], [-3, 500]])
    picture = draw_matches(image(1, 1), image(1, 1), points, points, matches, inliers, np.zeros((1, 1)))
    assert picture.shape[1] == 2 + GAP


def test_inputs_stay_as_they_are_and_threads_draw_the_same():
    grey = image()
    expected = drawn()
    for picture in in_threads(lambda: draw_matches(grey, grey, POINTS0, POINTS1, MATCHES, INLIERS)):
        np.testing.assert_array_equal(picture, expected)
    assert np.all(grey == GREY)


def caption(picture: np.ndarray) -> np.ndarray:
    return picture[HEIGHT + GAP :]


def test_the_caption_has_the_name_of_the_pair():
    captions = [
        caption(draw_matches(image(), image(), POINTS0, POINTS1, MATCHES, INLIERS, name=name))
        for name in ("", "street:3-9", "street:3-8")
    ]
    assert captions[1].shape == captions[2].shape
    assert not np.array_equal(captions[1], captions[2])
    assert captions[0].shape[0] <= captions[1].shape[0]


def test_the_caption_tells_the_colours_that_are_in_the_picture():
    picture = caption(drawn())
    found = {reason for reason, colour in COLOURS.items() if np.any(np.all(picture == colour, axis=2))}
    assert found == set(REASONS)
    bar = caption(drawn(score_map0=np.zeros((HEIGHT, WIDTH))))[HEIGHT + GAP :]
    for probability in (0.0, 0.5, 1.0):
        nearest = np.abs(bar.astype(int) - probability_colours(np.array(probability))).max(axis=2).min()
        assert nearest <= 6, probability


def test_text_and_overlays_grow_with_a_picture_that_is_shown_smaller():
    """As tall as 10 pixels where the picture is 400 wide, and circles of a visible line."""
    for width in (160, 640, 1280):
        wide = np.full((90, width), GREY, np.uint8)
        points = sure([[50, 45]])
        picture = draw_matches(wide, wide, points, points, *judged(1, 1, []), name="H")
        text = np.flatnonzero(picture[90 + GAP :, : round(0.04 * 2 * width)].max(axis=(1, 2)) > 150)
        rows = np.split(text, np.flatnonzero(np.diff(text) > 1) + 1)[0]
        ink = int(np.sum(np.all(picture[45, :width] == COLOURS[Reason.UNMATCHED], axis=1)))
        shown = min(1.0, 400 / picture.shape[1])
        assert len(rows) * shown >= 5.5, width  # a capital is some 0.7 of the size
        assert ink * shown >= 2, width
