import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from textured_scenes import texture
from tiny_network import save_lightning, tiny_network

from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint, start_from
from sips_lit.detect.covariance import covariance_matrices, covariances_at, scale_covariances
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor

IMAGE = texture(61, 83)


def with_head(seed: int = 0, **parameters) -> ScoreNetwork:
    """A tiny network whose head says something else of every pixel."""
    network = tiny_network(seed, covariance=True, **parameters)
    torch.nn.init.normal_(network.covariance_head.weight, std=0.1)
    torch.nn.init.normal_(network.covariance_head.bias)
    return network


def test_three_numbers_are_two_deviations_and_a_correlation():
    numbers = torch.tensor([[math.log(2.0), math.log(0.5), 0.0], [0.0, 1.0, 0.7]])
    wide, tilted = covariance_matrices(numbers)
    torch.testing.assert_close(wide, torch.diag(torch.tensor([4.0, 0.25])))  # x is wide, not y
    sigma = np.sqrt(np.diag(tilted))
    np.testing.assert_allclose(sigma, [1, math.e], rtol=1e-6)
    assert float(tilted[0, 1]) / sigma.prod() == pytest.approx(0.99 * math.tanh(0.7), rel=1e-6)
    assert float(tilted[0, 1]) == float(tilted[1, 0])


def test_any_numbers_give_a_covariance():
    for numbers in (torch.full((1, 3), 1e6), torch.full((1, 3), -1e6), torch.tensor([[50.0, -50.0, 30.0]])):
        values = np.linalg.eigvalsh(covariance_matrices(numbers).double())
        assert np.isfinite(values).all()
        assert values.min() > 0


def test_an_untrained_head_is_as_sure_of_all_points():
    points = SipsDetector(tiny_network(covariance=True), PointSelector()).detect(IMAGE, 5)
    np.testing.assert_allclose(points.covariance, np.broadcast_to(math.exp(-2) * np.eye(2), (5, 2, 2)), rtol=1e-6)


@pytest.mark.parametrize("derivatives", [False, True])
@pytest.mark.parametrize("scales", [1, 3])
def test_the_head_leaves_scores_and_points_as_they_are(derivatives, scales):
    plain, headed = (tiny_network(derivatives=derivatives, scales=scales, covariance=head) for head in (False, True))
    torch.nn.init.normal_(headed.covariance_head.weight)
    image = image_tensor(IMAGE)
    assert torch.equal(plain(image), headed(image))
    without, points = (SipsDetector(network, PointSelector()).detect(IMAGE, 30) for network in (plain, headed))
    np.testing.assert_array_equal(without.xy, points.xy)
    np.testing.assert_array_equal(without.score, points.score)
    assert without.covariance is None
    assert points.covariance.shape == (len(points), 2, 2)
    assert len(points) > 10
    assert points.covariance.dtype == np.float32


@pytest.mark.parametrize("derivatives", [False, True])
def test_covariances_are_those_of_a_dense_pass(derivatives):
    """Reading receptive fields gives what running the head over the whole image gives at those pixels."""
    network, image = with_head(3, derivatives=derivatives), image_tensor(IMAGE)
    points = PointSelector(subpixel=False).select(network, image, 25)
    features = []
    network.layers[-1].register_forward_pre_hook(lambda layer, inputs: features.append(inputs[0]))
    with torch.no_grad():
        network(image)
        dense = network.covariance_head(features[0])[0]
    expected = covariance_matrices(dense[:, points.row, points.column].T)
    torch.testing.assert_close(covariances_at(network, image, points).detach(), expected, rtol=1e-4, atol=1e-5)


def test_points_of_coarse_levels_are_less_sure():
    network = tiny_network(scales=3, scale_factor=2.0, covariance=True)
    points = SipsDetector(network, PointSelector()).detect(IMAGE, 60)
    assert set(points.scale) == {1, 2, 4}
    np.testing.assert_allclose(points.covariance[:, 1, 1], points.scale**2 * math.exp(-2), rtol=1e-6)


def test_only_the_head_gets_a_gradient():
    network, image = with_head(), image_tensor(IMAGE)
    points = PointSelector().select(network, image, 10)
    covariances_at(network, image, points).sum().backward()
    assert {name for name, p in network.named_parameters() if p.grad is not None} == {
        "covariance_head.weight",
        "covariance_head.bias",
    }


@pytest.mark.parametrize("suffix", [".ckpt", ".safetensors"])
def test_the_head_is_kept_in_files(tmp_path, suffix):
    network, path = with_head(1), tmp_path / f"best{suffix}"
    if suffix == ".ckpt":
        save_lightning(path, network, PointSelector())
    else:
        export_safetensors(network, PointSelector(), path)
    loaded, _ = load_checkpoint(path)
    points, again = (SipsDetector(one, PointSelector()).detect(IMAGE, 10) for one in (network, loaded))
    np.testing.assert_array_equal(points.covariance, again.covariance)


def test_a_head_is_put_on_a_trained_network_and_left_out(tmp_path):
    trained, path = tiny_network(7), tmp_path / "trained.safetensors"
    export_safetensors(trained, PointSelector(), path)
    headed = with_head(8)
    head = headed.covariance_head.weight.clone()
    start_from(headed, path)
    image = image_tensor(IMAGE)
    assert torch.equal(headed(image), trained(image))
    assert torch.equal(headed.covariance_head.weight, head)

    export_safetensors(headed, PointSelector(), path)
    bare = tiny_network(9)
    start_from(bare, path)
    assert torch.equal(bare(image), trained(image))


def test_covariances_are_multiplied_by_a_factor():
    network = with_head(2)
    before = SipsDetector(network, PointSelector()).detect(IMAGE, 20).covariance
    scale_covariances(network, 2.5)
    after = SipsDetector(network, PointSelector()).detect(IMAGE, 20).covariance
    np.testing.assert_allclose(after, 2.5 * before, rtol=1e-5)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.inf, math.nan])
def test_no_factor(factor):
    with pytest.raises(ValueError, match="multiplied"):
        scale_covariances(with_head(), factor)


def test_a_network_without_the_head():
    with pytest.raises(ValueError, match="multiplied"):
        scale_covariances(tiny_network(), 2.0)
    with pytest.raises(ValueError, match="no covariance head"):
        tiny_network().covariance_numbers(image_tensor(IMAGE), torch.tensor([3]), torch.tensor([4]))


def test_covariances_go_with_their_points():
    detector = SipsDetector(with_head(4), replace(PointSelector(), nms_radius=3))
    points = detector.detect(IMAGE, 20)
    np.testing.assert_array_equal(points[np.array([4, 2])].covariance, points.covariance[[4, 2]])
    np.testing.assert_array_equal(points.best(3).covariance, points.covariance[:3])
    np.testing.assert_array_equal(detector.best(points, 3).covariance, points.covariance[:3])


def test_no_points_have_no_covariances():
    assert SipsDetector(with_head(), PointSelector()).detect(IMAGE, 0).covariance.shape == (0, 2, 2)


@pytest.mark.parametrize("first_octave", [0, 1])
def test_covariances_are_of_the_image_whatever_octaves_score(first_octave):
    network = with_head(derivatives=True, first_octave=first_octave, octaves=2, corners=0.5)
    image = image_tensor(IMAGE)
    logits, numbers = network.logits_and_covariance_numbers(image)
    torch.testing.assert_close(logits, network(image))
    rows, columns = torch.tensor([0, 9, 31]), torch.tensor([7, 0, 22])
    expected = network.covariance_numbers(image, rows, columns)
    torch.testing.assert_close(numbers[0][:, rows, columns].T, expected, rtol=1e-4, atol=1e-5)
