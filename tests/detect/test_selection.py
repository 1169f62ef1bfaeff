import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from textured_scenes import texture

from sips_lit.detect.peaks import local_maxima
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import (
    OneOctave,
    PointSelector,
    all_finite,
    far_from_border,
    image_pyramid,
    image_tensor,
    logits_at,
    suppress_across_levels,
    to_full_resolution,
)
from sips_lit.errors import BadInputError


def network(scales: int = 1, depth: int = 4, seed: int = 0) -> ScoreNetwork:
    torch.manual_seed(seed)
    return ScoreNetwork(depth, 8, scales=scales)


def blob_network(scales: int) -> ScoreNetwork:
    """Logit = a centre-surround filter: high in the middle of bright blobs of one size."""
    net = ScoreNetwork(3, 2, leaky_slope=0.01, scales=scales)
    box = torch.full((3, 3), 1 / 9)
    surround = -box
    surround[1, 1] += 1
    with torch.no_grad():
        for layer, kernel in zip(net.layers, (box, box, surround), strict=True):
            layer.weight.zero_()
            layer.bias.zero_()
            layer.weight[0, 0] = kernel
        net.layers[0].bias.fill_(10)  # stays positive: the leaky ReLUs change nothing
    return net


IMAGE = image_tensor(texture(90, 121, 5))


def test_single_scale_is_the_best_local_maxima_of_the_map():
    net = network()
    with torch.no_grad():
        logits = net(IMAGE)[0, 0]
    rows, columns = local_maxima(logits, 5)
    points = PointSelector(5, subpixel=False).select(net, IMAGE, 12)
    np.testing.assert_array_equal(points.keypoints.xy, np.stack([columns, rows], 1)[:12])
    np.testing.assert_array_equal(points.row, rows[:12])
    np.testing.assert_array_equal(points.column, columns[:12])
    np.testing.assert_allclose(points.keypoints.score, torch.sigmoid(logits[rows, columns])[:12].numpy(), rtol=1e-6)
    assert set(points.level) == {0}
    assert set(points.keypoints.scale) == {1.0}


@pytest.mark.parametrize(("border", "margin"), [(0, 0), (4, 4), (5, 5), (24, 5)])
@pytest.mark.parametrize("scales", [1, 3])
def test_the_border_has_no_points_a_sixteenth_of_the_shorter_side_at_most(border, margin, scales):
    everywhere, inner = (
        PointSelector(2, subpixel=False, border=width).select(network(scales), IMAGE, 10_000) for width in (0, border)
    )
    height, width = IMAGE.shape[-2:]
    x, y = inner.keypoints.xy.T
    rounded = 0 if scales == 1 else 1  # of the sixteenth of a coarser level
    assert min(x.min(), width - 1 - x.max(), y.min(), height - 1 - y.max()) >= margin - rounded
    if scales == 1:
        x, y = everywhere.keypoints.xy.T
        kept = (x >= margin) & (x < width - margin) & (y >= margin) & (y < height - margin)
        np.testing.assert_array_equal(inner.keypoints.xy, everywhere.keypoints.xy[kept])
        assert len(inner) == len(everywhere) or margin
    assert PointSelector(2, border=border).anywhere == PointSelector(2)


def test_as_many_points_as_asked_for_where_better_ones_are_in_the_border():
    chosen = PointSelector(2, subpixel=False, border=5).select(network(), IMAGE, 10)
    more = PointSelector(2, subpixel=False, border=5).select(network(), IMAGE, 50)
    assert len(chosen) == 10
    np.testing.assert_array_equal(chosen.keypoints.xy, more.keypoints.xy[:10])


def test_a_network_of_several_octaves_and_corners_scores_one_octave_to_learn():
    net = ScoreNetwork(4, 8, octaves=2, corners=0.5)
    torch.testing.assert_close(OneOctave(net)(IMAGE), net.octave(IMAGE))
    assert (OneOctave(net)(IMAGE) - net(IMAGE)).abs().max() > 1e-3
    assert (OneOctave(net).scales, OneOctave(net).scale_factor) == (net.scales, net.scale_factor)


def test_sub_pixel_moves_points_by_half_a_pixel_at_most():
    net = network()
    coarse = PointSelector(5, subpixel=False).select(net, IMAGE, 40).keypoints
    fine = PointSelector(5, subpixel=True).select(net, IMAGE, 40).keypoints
    moved = np.abs(fine.xy - coarse.xy)
    assert 0.02 < moved.mean() < moved.max() <= 0.5
    np.testing.assert_array_equal(fine.score, coarse.score)


class Fixed(torch.nn.Module):
    """Gives one map of logits, whatever the image."""

    scales, scale_factor = 1, 2.0

    def __init__(self, logits: np.ndarray) -> None:
        super().__init__()
        self.logits = torch.from_numpy(logits)[None, None].float()

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return self.logits


@pytest.mark.parametrize("height", [-2.0, 3.0])
def test_the_top_of_a_parabola_of_logits_is_where_it_is(height):
    """Of probabilities it would be pulled to the pixel, or away from it: they are no parabola."""
    y, x = np.mgrid[:21, :31]
    logits = height - 1.5 * (x - 12.3) ** 2 - 0.7 * (y - 8.8) ** 2
    points = PointSelector().select(Fixed(logits), torch.zeros(1, 1, 21, 31), 1)
    np.testing.assert_allclose(points.keypoints.xy, [[12.3, 8.8]], atol=1e-4)
    assert (points.row.tolist(), points.column.tolist()) == ([9], [12])


@pytest.mark.parametrize(("apart", "count"), [(5, 1), (6, 2)])
def test_the_radius_is_five_pixels_by_default(apart, count):
    logits = np.full((20, 30), -5.0)
    logits[10, 10], logits[10, 10 + apart] = 2, 1
    points = PointSelector().select(Fixed(logits), torch.zeros(1, 1, 20, 30), 100)
    assert (points.keypoints.score > 0.5).sum() == count


@pytest.mark.parametrize("scales", [1, 4])
@pytest.mark.parametrize("radius", [2, 5])
def test_no_two_points_within_the_radius(scales, radius):
    points = PointSelector(radius, subpixel=False).select(network(scales), IMAGE, 10_000)
    distances = np.abs(points.keypoints.xy[:, None] - points.keypoints.xy[None]).max(2)
    np.fill_diagonal(distances, np.inf)
    assert distances.min() > radius - 1e-3
    if scales > 1:
        assert len(np.unique(points.level)) > 1


@pytest.mark.parametrize("scales", [1, 4])
@pytest.mark.parametrize("n", [0, 1, 7, 10_000])
def test_at_most_n_points_sorted_and_the_same_as_the_first_of_more(scales, n):
    net, selector = network(scales), PointSelector(3)
    points, all_points = selector.select(net, IMAGE, n), selector.select(net, IMAGE, 10_000)
    assert len(points) == min(n, len(all_points))
    assert (np.diff(points.keypoints.score) <= 0).all()
    np.testing.assert_array_equal(points.keypoints.xy, all_points.keypoints.xy[:n])
    np.testing.assert_array_equal(points.level, all_points.level[:n])
    np.testing.assert_allclose(points.keypoints.scale, net.scale_factor**points.level, rtol=1e-6)
    for array in (points.keypoints.xy, points.keypoints.score, points.keypoints.scale):
        assert array.dtype == np.float32


class GivenMaps:
    """Stands for a network of two scales, 2 apart, whose maps are known."""

    scales, scale_factor = 2, 2.0

    def __init__(self, fine: torch.Tensor, coarse: torch.Tensor) -> None:
        self.maps = {fine.shape: fine, coarse.shape: coarse}

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        return self.maps[image.shape[-2:]][None, None]


def test_points_lost_between_levels_are_replaced():
    fine, coarse = torch.full((40, 40), -9.0), torch.full((20, 20), -99.0)
    coarse[10, 10] = 9  # at (20.5, 20.5) of the image: it suppresses four points of the finer level
    for value, row, column in ((8, 18, 18), (7, 18, 23), (6, 23, 18), (5, 23, 23), (4, 5, 5)):
        fine[row, column] = value
    points = PointSelector(4, subpixel=False).select(GivenMaps(fine, coarse), torch.zeros(1, 1, 40, 40), 2)
    assert points.keypoints.xy.tolist() == [[20.5, 20.5], [5, 5]]
    assert points.keypoints.scale.tolist() == [2, 1]


def test_a_blob_is_found_in_the_level_that_shrinks_it_to_the_filter():
    rows, columns = np.mgrid[0:96, 0:130]
    x, y = 70.4, 41.7
    found = []
    for sigma in (1.5, 3.0, 6.0):
        image = 40 + 200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
        best = PointSelector(5).select(blob_network(7), image_tensor(image.astype(np.uint8)), 1)
        np.testing.assert_allclose(best.keypoints.xy[0], [x, y], atol=0.35)
        found.append(float(best.keypoints.scale[0]))
    assert found[0] < found[1] < found[2]
    assert found[2] / found[1] == pytest.approx(2, rel=0.5)


@pytest.mark.parametrize("scales", [1, 3])
@pytest.mark.parametrize("gradient", ["patches", "dense"])
def test_logits_and_gradients_at_the_points(scales, gradient):
    net = network(scales)
    points = PointSelector(5).select(net, IMAGE, 60)
    assert {int(level) for level in points.level} == set(range(scales))
    (logits,) = logits_at(net, [IMAGE], [points], gradient)
    np.testing.assert_allclose(torch.sigmoid(logits).detach().numpy(), points.keypoints.score, rtol=1e-4)
    (other,) = logits_at(net, [IMAGE], [points], "dense" if gradient == "patches" else "patches")
    weights = torch.linspace(1, 2, len(points))
    mine, twin = (
        torch.cat([g.flatten() for g in torch.autograd.grad((values * weights).sum(), list(net.parameters()))])
        for values in (logits, other)
    )
    assert float((mine - twin).norm() / twin.norm()) < 1e-5


def test_no_points_no_logits():
    net = network()
    points = PointSelector().select(net, IMAGE, 0)
    assert [of_image.shape for of_image in logits_at(net, [IMAGE, IMAGE], [points] * 2, "patches")] == [(0,), (0,)]


@pytest.mark.parametrize("scales", [1, 3])
def test_points_of_images_that_are_seen_together_are_those_of_each(scales):
    net, images = network(scales), torch.cat([IMAGE, IMAGE.flip(-1), IMAGE.flip(-2)])
    together = PointSelector(5).select_each(net, images, 30)
    for image, points in zip(images, together, strict=True):
        alone = PointSelector(5).select(net, image[None], 30)
        for name in ("level", "row", "column"):
            np.testing.assert_array_equal(getattr(points, name), getattr(alone, name))
        np.testing.assert_allclose(points.keypoints.xy, alone.keypoints.xy, atol=1e-3)
        np.testing.assert_allclose(points.keypoints.scale, alone.keypoints.scale)


@pytest.mark.parametrize("gradient", ["patches", "dense"])
def test_points_of_several_images_are_each_of_its_own(gradient):
    """Of two sizes, several scales, and one without points among them."""
    net, selector = network(3), PointSelector(5)
    images = [IMAGE, IMAGE.flip(-1), IMAGE[..., :40, :50], IMAGE.flip(-2)]
    points = [selector.select(net, image, n) for image, n in zip(images, (30, 0, 9, 50), strict=True)]
    for selected, logits in zip(points, logits_at(net, images, points, gradient), strict=True):
        np.testing.assert_allclose(torch.sigmoid(logits).detach().numpy(), selected.keypoints.score, rtol=1e-4)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (7, 1)])
@pytest.mark.parametrize("scales", [1, 5])
def test_tiny_images(size, scales):
    points = PointSelector().select(network(scales), image_tensor(np.full(size, 9, np.uint8)), 10)
    assert len(points) >= 1
    assert np.isfinite(points.keypoints.xy).all()


def test_broken_weights_are_told_to_the_user():
    net = network()
    with torch.no_grad():
        net.layers[1].weight[0, 0, 1, 1] = torch.nan
    with pytest.raises(BadInputError, match="not finite: its weights are broken"):
        PointSelector().select(net, IMAGE, 10)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.bfloat16])
@pytest.mark.parametrize("bad", [torch.nan, torch.inf, -torch.inf])
def test_one_value_that_is_not_finite_is_noticed(dtype, bad):
    values = torch.randn(7, 9, generator=torch.Generator().manual_seed(0)).to(dtype)
    assert all_finite(values)
    assert all_finite(values[:0])
    values[6, 0] = bad
    assert not all_finite(values)


@pytest.mark.parametrize("border", [0, 2, 3, 50])
def test_the_border_of_arrays_is_that_of_tensors(border):
    rows, columns = (grid.ravel() for grid in np.mgrid[0:70, 0:45])
    far = far_from_border(rows, columns, (70, 45), border)
    np.testing.assert_array_equal(
        far_from_border(torch.from_numpy(rows), torch.from_numpy(columns), (70, 45), border), far
    )
    margin = min(border, 2)  # 45 / 16
    expected = (np.minimum(rows, 69 - rows) >= margin) & (np.minimum(columns, 44 - columns) >= margin)
    np.testing.assert_array_equal(far, expected)


def test_a_negative_radius_is_refused():
    with pytest.raises(ValueError, match="nms_radius is -1"):
        PointSelector(nms_radius=-1)


@pytest.mark.parametrize("border", [-1, 1001, 1.5])
def test_a_border_counts_pixels(border):
    with pytest.raises(ValueError, match=f"border is {border}: it counts pixels, from 0 to 1000"):
        PointSelector(border=border)


def test_image_tensor_keeps_grey_values_of_any_view():
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)[:, ::-1]
    np.testing.assert_array_equal(image_tensor(image)[0, 0].numpy(), image.astype(np.float32))


ROOT2 = 2**0.5


def blob(height: int, width: int, x: float, y: float, sigma: float) -> torch.Tensor:
    rows, columns = np.mgrid[0:height, 0:width]
    image = 255 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return torch.from_numpy(image.astype(np.float32))[None, None]


def test_level_sizes():
    image = 255 * torch.rand(1, 1, 101, 64)
    levels = image_pyramid(image, 5, ROOT2)
    assert [tuple(level.shape[-2:]) for level in levels] == [(101, 64), (71, 45), (50, 32), (36, 23), (25, 16)]
    assert levels[0] is image


def test_levels_smaller_than_a_pixel_are_left_out():
    assert [tuple(x.shape[-2:]) for x in image_pyramid(torch.ones(1, 1, 3, 2), 5, 2.0)] == [(3, 2), (2, 1)]
    assert len(image_pyramid(torch.ones(1, 1, 9, 9), 1, 2.0)) == 1


def test_constant_images_stay_constant_and_fine_noise_is_filtered_out():
    for level in image_pyramid(torch.full((1, 1, 40, 30), 77.0), 4, ROOT2):
        torch.testing.assert_close(level, torch.full_like(level, 77.0))
    checkerboard = 255.0 * (torch.arange(64)[:, None] + torch.arange(64)[None]).remainder(2)
    inner = image_pyramid(checkerboard[None, None], 3, 2.0)[2][..., 2:-2, 2:-2]
    assert float((inner - 127.5).abs().max()) < 8


@pytest.mark.parametrize("factor", [ROOT2, 2.0, 1.3])
@pytest.mark.parametrize(("x", "y"), [(31.3, 40.8), (50.0, 22.5)])
def test_a_blob_is_at_its_place_in_every_level(factor, x, y):
    height, width = 71, 83
    for level in image_pyramid(blob(height, width, x, y, 5.0), 4, factor):
        weight = level[0, 0] / level.sum()
        size = (level.shape[-2], level.shape[-1])
        centre = [float((weight * torch.arange(size[1])).sum()), float((weight * torch.arange(size[0])[:, None]).sum())]
        seen = to_full_resolution(np.array([centre]), size, (height, width))[0]
        np.testing.assert_allclose(seen, [x, y], atol=0.02)


def test_corners_of_a_level_are_corners_of_the_image():
    # the outer edge of the image is half a pixel outside the centres of its first and last pixels, in every level
    edges = np.array([[-0.5, -0.5], [9.5, 4.5]])
    np.testing.assert_allclose(to_full_resolution(edges, (5, 10), (21, 37)), [[-0.5, -0.5], [36.5, 20.5]])


@given(st.integers(1, 200), st.integers(1, 200), st.integers(1, 90), st.integers(1, 90))
@settings(max_examples=50, deadline=None)
def test_there_and_back(height, width, level_height, level_width):
    xy = np.array([[0.0, 0.0], [level_width - 1, level_height - 1], [0.3, 7.7]])
    there = to_full_resolution(xy, (level_height, level_width), (height, width))
    back = to_full_resolution(there, (height, width), (level_height, level_width))
    np.testing.assert_allclose(back, xy, rtol=0, atol=1e-9)


def slow_suppression(xy: np.ndarray, level: np.ndarray, radius: float, n: int) -> list[int]:
    kept: list[int] = []
    for i in range(len(xy)):
        distances = [max(abs(xy[i] - xy[j])) for j in kept if level[j] != level[i]]
        if len(kept) < n and all(distance > radius for distance in distances):
            kept.append(i)
    return kept


@given(st.data(), st.integers(0, 30), st.sampled_from([0.0, 1.0, 2.0, 5.0]), st.integers(0, 40))
@settings(max_examples=60, deadline=None)
def test_suppression_as_the_slow_twin(data, count, radius, n):
    xy = data.draw(arrays(np.float32, (count, 2), elements=st.integers(0, 12).map(float)))
    level = data.draw(arrays(np.int64, count, elements=st.integers(0, 3)))
    assert suppress_across_levels(xy, level, radius, n).tolist() == slow_suppression(xy, level, radius, n)


def test_the_distance_of_suppression():
    xy, level = np.array([[0, 0], [5, 3], [6, 0], [0, 5]], np.float32), np.array([0, 1, 1, 0])
    assert suppress_across_levels(xy, level, 5, 9).tolist() == [0, 2, 3]


@pytest.mark.parametrize("height", [-2.0, 3.0])
def test_of_coarser_levels_too_the_fit_is_on_logits(height):
    y, x = np.mgrid[:20, :20]
    coarse = torch.from_numpy(height - 1.5 * (x - 9.3) ** 2 - 0.7 * (y - 7.8) ** 2).float()
    points = PointSelector().select(GivenMaps(torch.full((40, 40), -99.0), coarse), torch.zeros(1, 1, 40, 40), 1)
    np.testing.assert_allclose(points.keypoints.xy, [[9.8 * 2 - 0.5, 8.3 * 2 - 0.5]], atol=1e-3)
    assert points.level.tolist() == [1]


def test_of_two_points_whose_probabilities_round_to_one_the_better_stays():
    logits = np.full((20, 30), -5.0)
    logits[10, 10], logits[10, 12] = 29, 30
    points = PointSelector(subpixel=False).select(Fixed(logits), torch.zeros(1, 1, 20, 30), 1)
    assert points.keypoints.xy.tolist() == [[12, 10]]
