import math

import pytest
import torch
from torch import nn

from sips_lit.detect.corners import corner_strength
from sips_lit.detect.octaves import enlarged, halves
from sips_lit.detect.score_network import ScoreNetwork


def network(depth: int = 4, width: int = 8, seed: int = 0) -> ScoreNetwork:
    torch.manual_seed(seed)
    return ScoreNetwork(depth, width)


def noise(height: int, width: int, batch: int = 1, seed: int = 1) -> torch.Tensor:
    return 255 * torch.rand(batch, 1, height, width, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize(
    ("depth", "width", "outputs"),
    [
        (10, 32, [16] * 5 + [32] * 4 + [1]),
        (5, 8, [4, 4, 8, 8, 1]),
        (2, 2, [1, 1]),
        (12, 256, [128] * 6 + [256] * 5 + [1]),
    ],
)
def test_half_the_width_in_the_first_half_of_the_layers(depth, width, outputs):
    layers = list(ScoreNetwork(depth, width).layers)
    assert [layer.out_channels for layer in layers] == outputs
    assert [layer.in_channels for layer in layers] == [1, *outputs[:-1]]
    assert {layer.kernel_size for layer in layers} == {(3, 3)}


def test_the_small_paper_network_has_42113_weights():
    assert sum(p.numel() for p in ScoreNetwork(10, 32).parameters()) == 42113


def test_the_default_is_the_small_paper_network_on_a_single_scale():
    net = ScoreNetwork()
    assert sum(p.numel() for p in net.parameters()) == 42113
    assert (net.radius, net.scales) == (10, 1)
    assert net.scale_factor == pytest.approx(2**0.5)


def test_probabilities_start_near_those_of_the_bias():
    with torch.no_grad():
        probability = torch.sigmoid(network(10, 32)(noise(40, 40)))
    assert float(probability.mean()) == pytest.approx(torch.sigmoid(torch.tensor(-1.5)).item(), abs=0.05)
    assert float(probability.std()) > 1e-4  # the points of an untrained network have an order


@pytest.mark.parametrize(("depth", "row", "column"), [(2, 9, 9), (4, 10, 12), (5, 0, 7)])
def test_receptive_field_is_exactly_the_radius(depth, row, column):
    net, image = network(depth), noise(24, 26)
    with torch.no_grad():
        before = net(image)[0, 0, row, column]
        beyond = image.clone()
        beyond[0, 0, row + depth + 1, :] = 255 - beyond[0, 0, row + depth + 1, :]
        beyond[0, 0, :, column + depth + 1] = 255 - beyond[0, 0, :, column + depth + 1]
        assert net(beyond)[0, 0, row, column] == before
        at_edge = image.clone()
        at_edge[0, 0, row + depth, column + depth] += 2000
        assert net(at_edge)[0, 0, row, column] != before
    assert net.radius == depth


@pytest.mark.parametrize("slope", [0.01, 0.3])
@pytest.mark.parametrize("size", [(17, 23), (1, 1), (2, 9), (3, 3)])
def test_the_whole_map_is_that_of_a_plain_network_on_a_replicated_border(size, slope):
    torch.manual_seed(0)
    net, image = ScoreNetwork(6, 8, leaky_slope=slope), noise(*size)
    plain: list[nn.Module] = [nn.ReplicationPad2d(6)]
    for layer in net.layers:
        plain += [layer, nn.LeakyReLU(slope)]
    with torch.no_grad():
        expected = nn.Sequential(*plain[:-1])((image - 127) / 64)
        actual = net(image)
    assert actual.shape == (1, 1, *size)
    torch.testing.assert_close(actual, expected, rtol=1e-4, atol=1e-5)


def test_with_and_without_gradient_the_logits_are_equal():
    net, image = network(5), noise(20, 21)
    with torch.no_grad():
        inference = net(image)
    torch.testing.assert_close(net(image).detach(), inference, rtol=0, atol=1e-6)


@pytest.mark.parametrize("size", [(33, 41), (1, 5)])
def test_a_batch_gives_what_single_images_give(size):
    net, images = network(), noise(*size, batch=3)
    with torch.no_grad():
        singles = torch.cat([net(image[None]) for image in images])
        torch.testing.assert_close(net(images), singles, rtol=0, atol=1e-5)


def at(net: ScoreNetwork, image: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, route) -> torch.Tensor:
    (logits,) = net.at([image], [(rows, columns)], route)
    return logits


def gradient_of(net: ScoreNetwork, logits: torch.Tensor) -> torch.Tensor:
    weights = torch.linspace(-1, 1, len(logits))
    gradients = torch.autograd.grad((logits * weights).sum(), list(net.parameters()))
    return torch.cat([gradient.flatten() for gradient in gradients])


@pytest.mark.parametrize(("depth", "size"), [(4, (21, 30)), (10, (25, 25)), (6, (3, 4))])
def test_patches_have_the_logits_and_gradients_of_the_dense_map(depth, size):
    net, image = network(depth), noise(*size)
    generator = torch.Generator().manual_seed(3)
    height, width = size
    rows = torch.cat([torch.randint(height, (9,), generator=generator), torch.tensor([0, 0, height - 1, height - 1])])
    columns = torch.cat([torch.randint(width, (9,), generator=generator), torch.tensor([0, width - 1, 0, width - 1])])
    patches, dense = at(net, image, rows, columns, "patches"), at(net, image, rows, columns, "dense")
    with torch.no_grad():
        torch.testing.assert_close(dense, net(image)[0, 0, rows, columns], rtol=0, atol=1e-6)
    torch.testing.assert_close(patches, dense, rtol=1e-5, atol=1e-5)
    expected, actual = gradient_of(net, dense), gradient_of(net, patches)
    assert float((actual - expected).norm() / expected.norm()) < 1e-5


@pytest.mark.parametrize("route", ["patches", "dense"])
def test_no_pixels_no_logits(route):
    none = torch.zeros(0, dtype=torch.long)
    assert at(network(), noise(9, 9), none, none, route).shape == (0,)


@pytest.mark.parametrize("route", ["patches", "dense"])
def test_images_seen_together_have_the_logits_and_gradients_of_each_alone(route):
    net = network()
    images = [noise(12, 15, seed=1), noise(20, 9, seed=2), noise(12, 15, seed=3), noise(9, 20, seed=4)]
    places = [(torch.tensor(rows), torch.tensor(columns)) for rows, columns in (
        ([0, 11, 3], [14, 2, 7]), ([19], [8]), ([5, 6], [1, 0]), ([2, 0, 8, 4], [19, 3, 4, 10])
    )]  # fmt: skip
    alone = [at(net, image, *of_image, route) for image, of_image in zip(images, places, strict=True)]
    together = net.at(images, places, route)
    for one, other in zip(alone, together, strict=True):
        torch.testing.assert_close(other, one, rtol=1e-5, atol=1e-5)
    gradients = (gradient_of(net, torch.cat(logits)) for logits in (together, alone))
    torch.testing.assert_close(*gradients, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(("route", "passes"), [("patches", 1), ("dense", 2)])
def test_images_are_seen_in_one_pass_dense_ones_in_one_of_each_size(route, passes):
    net, calls = network(), []
    net.layers[0].register_forward_hook(lambda *_: calls.append(1))
    corner = torch.tensor([0]), torch.tensor([0])
    net.at([noise(9, 12), noise(8, 7), noise(9, 12, seed=1)], [corner] * 3, route)
    assert len(calls) == passes


@pytest.mark.parametrize(("depth", "width"), [(1, 8), (4, 7), (4, 0), (0, 2), (10**9, 4), (2.5, 4)])
def test_impossible_layers_are_refused(depth, width):
    with pytest.raises(ValueError, match="a depth of 2 to 1000 and an even width"):
        ScoreNetwork(depth, width)


@pytest.mark.parametrize(
    ("scales", "factor"), [(0, 1.4), (2, 1.0), (10**9, 1.4), (1.5, 1.4), (2, math.nan), (2, 1e300)]
)
def test_impossible_pyramids_are_refused(scales, factor):
    with pytest.raises(ValueError, match="1 to 32 scales"):
        ScoreNetwork(4, 8, scales=scales, scale_factor=factor)


def test_config_rebuilds_the_network():
    net = ScoreNetwork(3, 4, leaky_slope=0.2, start_bias=-1.0, scales=2, scale_factor=1.5)
    again = ScoreNetwork(**net.config)
    again.load_state_dict(net.state_dict())
    with torch.no_grad():
        torch.testing.assert_close(again(noise(9, 9)), net(noise(9, 9)), rtol=0, atol=0)


@pytest.fixture
def differentiating() -> ScoreNetwork:
    torch.manual_seed(0)
    return ScoreNetwork(4, 8, derivatives=True)


def test_derivatives_add_inputs_and_a_pixel_but_no_other_weights(differentiating):
    assert differentiating.layers[0].in_channels == 7
    assert set(differentiating.state_dict()) == set(network().state_dict())
    assert differentiating.radius == 5
    assert ScoreNetwork(**differentiating.config).derivatives


def test_the_receptive_field_with_derivatives(differentiating):
    image = noise(24, 26)
    with torch.no_grad():
        before = differentiating(image)[0, 0, 9, 10]
        for off, same in ((6, True), (5, False)):
            changed = image.clone()
            changed[0, 0, 9 + off, 10 + off] += 2000
            assert (differentiating(changed)[0, 0, 9, 10] == before) == same
        assert differentiating(image).shape == (1, 1, 24, 26)


def test_with_derivatives_patches_are_the_dense_map_and_gradients_flow(differentiating):
    image, rows, columns = noise(20, 21), torch.tensor([0, 7, 19]), torch.tensor([20, 3, 0])
    patches, dense = (at(differentiating, image, rows, columns, route) for route in ("patches", "dense"))
    torch.testing.assert_close(patches, dense, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(
        gradient_of(differentiating, patches), gradient_of(differentiating, dense), rtol=1e-3, atol=1e-4
    )


def test_derivatives_are_taken_in_full_precision(differentiating):
    """Rounded to bfloat16 first, a slope of one grey value a pixel on a bright image would be steps."""
    ramp = (200 + torch.arange(26.0)).expand(24, 26)[None, None].contiguous()
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        inside = differentiating(ramp)[0, 0, 6:-6, 6:-6]
    with torch.no_grad():
        expected = differentiating(ramp)[0, 0, 6:-6, 6:-6]
    torch.testing.assert_close(inside, expected, rtol=0.03, atol=0.03)


@pytest.mark.parametrize("derivatives", [False, True])
@pytest.mark.parametrize("further", [0, 3])
def test_the_interior_is_a_part_of_the_whole_map(derivatives, further):
    torch.manual_seed(0)
    net = ScoreNetwork(4, 8, derivatives=derivatives)
    image, margin = noise(30, 41, batch=2), net.radius + further
    torch.testing.assert_close(net.interior(image, margin), net(image)[..., margin:-margin, margin:-margin])


def test_a_call_sees_all_octaves_and_corners_and_learning_one_octave():
    torch.manual_seed(0)
    net, image = ScoreNetwork(4, 8, octaves=2, corners=0.5), noise(21, 22)
    one = ScoreNetwork(4, 8)
    one.load_state_dict(net.state_dict())
    rows, columns = torch.tensor([0, 7, 20]), torch.tensor([21, 3, 0])
    (half,) = halves(image, 2)
    mean = (one(image) + enlarged(one(half), 1, (21, 22))) / 2
    torch.testing.assert_close(net(image), mean + corner_strength(image, 0.5), rtol=0, atol=0)
    assert (net(image) - one(image)).abs().max() > 1e-3
    for route in ("patches", "dense"):
        torch.testing.assert_close(at(net, image, rows, columns, route), at(one, image, rows, columns, route))
    torch.testing.assert_close(net.interior(image, 5), one.interior(image, 5))


def test_half_of_the_image_may_be_all_that_a_call_sees():
    torch.manual_seed(0)
    net, image = ScoreNetwork(4, 8, first_octave=1, fine_corners=0.5), noise(21, 22)
    one = ScoreNetwork(4, 8)
    one.load_state_dict(net.state_dict())
    (half,) = halves(image, 2)
    expected = enlarged(one(half), 1, (21, 22)) + corner_strength(image, 0, 0.5)
    torch.testing.assert_close(net(image), expected, rtol=0, atol=0)
    rows, columns = torch.tensor([0, 7, 20]), torch.tensor([21, 3, 0])
    torch.testing.assert_close(at(net, image, rows, columns, "patches"), at(one, image, rows, columns, "patches"))


def test_detection_out_of_range_is_refused():
    with pytest.raises(ValueError, match="sees 1 to 8 octaves, not 0"):
        ScoreNetwork(3, 4, octaves=0)
    with pytest.raises(ValueError, match="fine_corners weigh 0 to 10, not -1"):
        ScoreNetwork(3, 4).detecting_by(fine_corners=-1)
