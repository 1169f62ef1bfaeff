import numpy as np
import pytest
import torch
import torch.nn.functional as F

from sips_lit.detect.derivatives import derivative_filters
from sips_lit.detect.folding import block_side, folded_filters, folded_valid, folded_weight, whole_blocks
from sips_lit.detect.score_network import ScoreNetwork


def random_image(*shape: int) -> torch.Tensor:
    return torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(1)).float()


@pytest.mark.parametrize("side", [1, 2, 3])
def test_a_layer_on_blocks_is_the_layer_on_pixels(side):
    generator = torch.Generator().manual_seed(0)
    weight, x = torch.randn(5, 3, 3, 3, generator=generator), torch.randn(2, 3, 14, 20, generator=generator)
    pixels = F.conv2d(x, weight)
    blocks = F.conv2d(
        F.pixel_unshuffle(x[..., : 14 // side * side, : 20 // side * side], side), folded_weight(weight, side)
    )
    whole = F.pixel_shuffle(blocks, side)
    torch.testing.assert_close(whole, pixels[..., : whole.shape[-2], : whole.shape[-1]], rtol=1e-5, atol=1e-5)
    assert whole.shape[-2] >= pixels.shape[-2] - side


def test_filters_of_a_grey_image_give_it_and_its_derivatives_exactly():
    image, filters = random_image(1, 1, 12, 16), derivative_filters()
    found = F.conv2d(image, folded_filters(filters, 2), stride=2)
    expected = torch.cat([image[..., 1:-1, 1:-1], F.conv2d(image, filters)], 1)
    assert torch.equal(F.pixel_shuffle(found, 2), expected)


@pytest.mark.parametrize("options", [{"derivatives": True}, {"width": 2, "depth": 3}, {"width": 10}])
@pytest.mark.parametrize("shape", [(1, 1, 98, 130), (2, 1, 60, 50), (1, 1, 2, 2)])
def test_the_folded_network_is_the_network(options, shape):
    torch.manual_seed(0)
    network = ScoreNetwork(**{"depth": 6, "width": 8, **options}).eval()
    padded = network.pad(random_image(*shape))
    with torch.no_grad():
        expected = network.valid(padded)
        found = folded_valid(network)(padded)
    assert expected.std() > 1e-3
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)


def test_narrow_networks_are_folded():
    assert [block_side(ScoreNetwork(4, width)) for width in (2, 8, 10, 32)] == [2, 2, 1, 1]


def test_whole_blocks_repeat_the_last_pixels():
    image = random_image(1, 1, 3, 4)
    assert whole_blocks(image, 1) is image or torch.equal(whole_blocks(image, 1), image)
    np.testing.assert_array_equal(whole_blocks(image, 2), np.pad(image, ((0, 0), (0, 0), (0, 1), (0, 0)), "edge"))
