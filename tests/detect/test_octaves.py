import cv2
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from textured_scenes import texture

from sips_lit.detect.octaves import enlarged, half_size, halves, mean_over_octaves, two_thirds
from sips_lit.detect.selection import image_tensor


def ramp(height: int, width: int) -> torch.Tensor:
    """Each pixel's value tells its row and column."""
    rows, columns = torch.arange(float(height))[:, None], torch.arange(float(width))
    return (3 * rows + columns)[None, None]


@pytest.mark.parametrize(
    ("octaves", "first", "step"),
    [
        (1, 0, 1),
        (2, 0, 1),
        (3, 0, 1),
        (1, 1, 1),
        (2, 1, 1),
        (1, 2, 1),
        (1, 0.5, 1),
        (2, 0.5, 0.5),
        (4, 0, 0.5),
        (1, 1.5, 1),
    ],
)
@pytest.mark.parametrize("size", [(40, 56), (41, 55), (42, 57)])
def test_every_octave_tells_the_same_place(octaves, first, step, size):
    """A half-pixel off, and the ramp of a coarser octave would lie beside that of the image."""
    found, inner = mean_over_octaves(lambda image: image, ramp(*size), octaves, first, step), slice(8, -8)
    torch.testing.assert_close(found[..., inner, inner], ramp(*size)[..., inner, inner])
    assert found.shape == (1, 1, *size)


def test_the_mean_is_that_of_the_logits_of_an_image_and_of_its_half():
    image = texture(48, 60, 2)
    half = cv2.resize(image.astype(np.float32), (30, 24), interpolation=cv2.INTER_AREA)

    def logits_of(x: torch.Tensor) -> torch.Tensor:
        return x**2  # depends on the order of averaging and scoring

    larger = cv2.resize(half**2, (60, 48), interpolation=cv2.INTER_LINEAR)
    expected = (image.astype(np.float32) ** 2 + larger) / 2
    found = mean_over_octaves(logits_of, image_tensor(image), 2)[0, 0].numpy()
    np.testing.assert_allclose(found[:46, :58], expected[:46, :58], rtol=1e-5)


def test_between_two_octaves_lies_one_of_two_thirds():
    image = texture(48, 60, 2)
    smaller = cv2.resize(image.astype(np.float32), (40, 32), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(two_thirds(image_tensor(image))[0, 0, :32, :40], smaller, rtol=1e-5)
    larger = cv2.resize(smaller**2, (60, 48), interpolation=cv2.INTER_LINEAR)
    found = mean_over_octaves(lambda x: x**2, image_tensor(image), 1, 0.5)[0, 0].numpy()
    np.testing.assert_allclose(found[:46, :58], larger[:46, :58], rtol=1e-4)


@pytest.mark.parametrize(
    ("octaves", "first", "step", "seen"),
    [
        (1, 0, 1, [120]),
        (1, 1, 1, [60]),
        (2, 1, 1, [60, 30]),
        (1, 2, 1, [30]),
        (2, 0.5, 0.5, [80, 60]),
        (2, 0.5, 1, [80, 40]),
        (4, 0, 0.5, [120, 80, 60, 40]),
    ],
)
def test_only_octaves_from_the_first_on_are_scored(octaves, first, step, seen):
    rows = []

    def logits_of(x: torch.Tensor) -> torch.Tensor:
        rows.append(round(x.shape[-2] / 10) * 10)  # an octave goes on for a few pixels
        return x

    assert mean_over_octaves(logits_of, ramp(120, 56), octaves, first, step).shape == (1, 1, 120, 56)
    assert rows == seen


@pytest.mark.parametrize(("size", "expected"), [((1, 1), (2, 2)), ((2, 5), (2, 4)), ((6, 7), (4, 5))])
def test_an_octave_covers_the_image_and_has_two_pixels_at_least(size, expected):
    (half,) = halves(ramp(*size), 2)
    assert half.shape == (1, 1, *expected)
    assert enlarged(half, 1, size).shape == (1, 1, *size)


@pytest.mark.parametrize(("size", "expected"), [((1, 1), (4, 4)), ((2, 5), (4, 6)), ((6, 7), (6, 8)), ((9, 8), (8, 8))])
def test_so_does_two_thirds_of_it(size, expected):
    smaller = two_thirds(ramp(*size))
    assert smaller.shape == (1, 1, *expected)
    assert enlarged(smaller, 0.5, size).shape == (1, 1, *size)
    assert enlarged(two_thirds(halves(ramp(*size), 2)[0]), 1.5, size).shape == (1, 1, *size)


def test_two_thirds_are_of_float32_under_autocast():
    image = 128 + 1000 * torch.rand(1, 1, 20, 30, generator=torch.Generator().manual_seed(0))
    with torch.autocast("cpu", torch.bfloat16):
        found = enlarged(two_thirds(image), 0.5, (20, 30))
    torch.testing.assert_close(found, enlarged(two_thirds(image), 0.5, (20, 30)), rtol=0, atol=0)


def test_an_image_goes_on_with_its_last_pixels():
    (half,) = halves(torch.tensor([[1.0, 2.0, 4.0]])[None, None], 2)
    assert half[0, 0].tolist() == [[1.5, 4.0, 4.0]] * 2
    assert halves(ramp(3, 3), 1) == []


@pytest.mark.parametrize("size", [(2, 3, 8, 10), (1, 1, 9, 7), (1, 3, 2, 3)])
def test_half_size_is_what_pooling_gives(size):
    values = 1000 * torch.randn(size, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(half_size(values), F.avg_pool2d(values, 2), rtol=0, atol=0)
