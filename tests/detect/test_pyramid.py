import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sips_lit.detect.pyramid import image_pyramid, suppress_across_levels, to_full_resolution

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
        seen = to_full_resolution(torch.tensor([centre]), size, (height, width))[0]
        np.testing.assert_allclose(seen.numpy(), [x, y], atol=0.02)


def test_corners_of_a_level_are_corners_of_the_image():
    # the outer edge of the image is half a pixel outside the centres of its first and last pixels, in every level
    edges = torch.tensor([[-0.5, -0.5], [9.5, 4.5]])
    np.testing.assert_allclose(to_full_resolution(edges, (5, 10), (21, 37)).numpy(), [[-0.5, -0.5], [36.5, 20.5]])


@given(st.integers(1, 200), st.integers(1, 200), st.integers(1, 90), st.integers(1, 90))
@settings(max_examples=50, deadline=None)
def test_there_and_back(height, width, level_height, level_width):
    xy = torch.tensor([[0.0, 0.0], [level_width - 1, level_height - 1], [0.3, 7.7]], dtype=torch.float64)
    there = to_full_resolution(xy, (level_height, level_width), (height, width))
    back = to_full_resolution(there, (height, width), (level_height, level_width))
    torch.testing.assert_close(back, xy, rtol=0, atol=1e-9)


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
