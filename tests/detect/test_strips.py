import pytest
import torch

from sips_lit.detect import strips
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.strips import logits_by_strips, strip_rows


def random_image(*shape: int) -> torch.Tensor:
    return torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(1)).float()


@pytest.fixture
def _low_strips(monkeypatch):
    """Of 20 rows or so: these images have several."""
    monkeypatch.setattr(strips, "STRIP_BYTES", 1)
    monkeypatch.setattr(strips, "RADII", 3)


@pytest.mark.usefixtures("_low_strips")
@pytest.mark.parametrize(
    "options",
    [
        {"width": 8, "derivatives": True, "octaves": 2, "corners": 0.5},
        {"width": 10, "octaves": 2, "first_octave": 0.5, "octave_step": 0.5},
        {"width": 8, "derivatives": True, "first_octave": 1, "corners": 0.5, "fine_corners": 0.25},
        {"width": 8, "derivatives": True, "first_octave": 1, "fine_corners": 0.25, "whole_below": 1_000_000},
        {"width": 10},
    ],
)
@pytest.mark.parametrize("shape", [(1, 1, 97, 131), (2, 1, 60, 50), (1, 1, 5, 3), (1, 1, 1, 1)])
def test_strips_give_the_logits_of_the_whole_image(options, shape):
    torch.manual_seed(0)
    network, image = ScoreNetwork(depth=6, **options).eval(), random_image(*shape)
    with torch.no_grad():
        expected = network(image)
        found = logits_by_strips(network, image)
    assert expected.numel() == 1 or expected.std() > 1e-3
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)
    assert found.is_contiguous()


@pytest.mark.usefixtures("_low_strips")
@pytest.mark.parametrize("width", [8, 10])
def test_no_layer_sees_more_than_a_strip(width, monkeypatch):
    network, heights = ScoreNetwork(depth=4, width=width).eval(), []
    convolution = torch.nn.functional.conv2d

    def watched(x, *others, **options):
        heights.append(x.shape[-2])
        return convolution(x, *others, **options)

    monkeypatch.setattr(torch.nn.functional, "conv2d", watched)
    monkeypatch.setattr(torch.nn.Conv2d, "_conv_forward", lambda layer, x, weight, bias: watched(x, weight, bias))
    logits_by_strips(network, random_image(1, 1, 200, 30))
    assert heights
    assert max(heights) <= strip_rows(network, 200, 30) + 2 * network.radius < 30


@pytest.mark.parametrize("width", [8, 32, 128])
@pytest.mark.parametrize("size", [(480, 640), (481, 640), (2160, 3840), (1, 1), (7, 100000)])
def test_strips_are_alike_and_neither_large_nor_low(width, size):
    network = ScoreNetwork(10, width)
    rows, (height, across) = strip_rows(network, *size), size
    assert rows % 2 == 0 or width > 8
    largest = max(1e6, 4 * width * across * 8 * network.radius)
    assert 4 * width * across * (rows - 2) <= largest
    count = -(-height // rows)
    assert count == 1 or rows > 4 * network.radius
    assert height - (count - 1) * rows > rows - 2 * count  # of the last one


def test_the_weights_are_those_that_the_network_has_now():
    network, image = ScoreNetwork(3, 4).eval(), random_image(1, 1, 9, 9)
    with torch.no_grad():
        before = logits_by_strips(network, image)
        network.layers[-1].bias.add_(1)
        torch.testing.assert_close(logits_by_strips(network, image), before + 1)
