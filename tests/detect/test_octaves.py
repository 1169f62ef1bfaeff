import cv2
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from textured_scenes import texture

from sips_lit.detect.octaves import enlarged, half_size, halves, mean_over_octaves
from sips_lit.detect.selection import image_tensor


def ramp(height: int, width: int) -> torch.Tensor:
    """Each pixel's value tells its row and column."""
    rows, columns = torch.arange(float(height))[:, None], torch.arange(float(width))
    return (3 * rows + columns)[None, None]


@pytest.mark.parametrize(("octaves", "first"), [(1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (1, 2)])
@pytest.mark.parametrize("size", [(40, 56), (41, 55)])
def test_every_octave_tells_the_same_place(octaves, first, size):
    """A half-pixel off, and the ramp of a coarser octave would lie beside that of the image."""
    found, inner = mean_over_octaves(lambda image: image, ramp(*size), octaves, first), slice(8, -8)
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


@pytest.mark.parametrize(("octaves", "first", "seen"), [(1, 0, [40]), (1, 1, [20]), (2, 1, [20, 10]), (1, 2, [10])])
def test_only_octaves_from_the_first_on_are_scored(octaves, first, seen):
    rows = []

    def logits_of(x: torch.Tensor) -> torch.Tensor:
        rows.append(round(x.shape[-2] / 10) * 10)  # an octave goes on for a pixel or two
        return x

    assert mean_over_octaves(logits_of, ramp(40, 56), octaves, first).shape == (1, 1, 40, 56)
    assert rows == seen


@pytest.mark.parametrize(("size", "expected"), [((1, 1), (2, 2)), ((2, 5), (2, 4)), ((6, 7), (4, 5))])
def test_an_octave_covers_the_image_and_has_two_pixels_at_least(size, expected):
    (half,) = halves(ramp(*size), 2)
    assert half.shape == (1, 1, *expected)
    assert enlarged(half, 1, size).shape == (1, 1, *size)


def test_an_image_goes_on_with_its_last_pixels():
    (half,) = halves(torch.tensor([[1.0, 2.0, 4.0]])[None, None], 2)
    assert half[0, 0].tolist() == [[1.5, 4.0, 4.0]] * 2
    assert halves(ramp(3, 3), 1) == []


@pytest.mark.parametrize("size", [(2, 3, 8, 10), (1, 1, 9, 7), (1, 3, 2, 3)])
def test_half_size_is_what_pooling_gives(size):
    values = 1000 * torch.randn(size, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(half_size(values), F.avg_pool2d(values, 2), rtol=0, atol=0)
