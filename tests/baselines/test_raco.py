import numpy as np
import pytest
import torch
from detector_contract import check_contract, scene
from learned_baselines import check_no_gradients
from random_weights import weights_file

from sips_lit.baselines.raco import RaCo, RaCoNetwork, sample_pixels, softmax_offsets
from sips_lit.errors import BadInputError


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return str(weights_file("raco", tmp_path_factory.mktemp("raco")))


@pytest.mark.parametrize("ranker", [True, False])
def test_contract_with_random_weights(weights, ranker):
    detector = RaCo(weights, ranker)
    check_contract(detector, None)
    check_no_gradients(detector)


def test_missing_and_other_weights_are_refused(tmp_path):
    with pytest.raises(BadInputError, match=r"in no package: download raco\.pth .*cvg/RaCo .*detector\.weights"):
        RaCo()
    with pytest.raises(BadInputError, match=r"no file of weights .*gone\.pth"):
        RaCo(str(tmp_path / "gone.pth"))
    with pytest.raises(BadInputError, match=r"superpoint\.pth does not hold the weights of RaCo"):
        RaCo(str(weights_file("superpoint", tmp_path)))
    torch.save({1: torch.zeros(1)}, tmp_path / "number.pth")
    with pytest.raises(BadInputError, match=r"number\.pth does not hold"):
        RaCo(str(tmp_path / "number.pth"))


def test_names_may_begin_with_the_models(weights, tmp_path):
    """As in files of before the release."""
    held = torch.load(weights, weights_only=True)
    torch.save({f"model.{key}": value for key, value in held.items()}, tmp_path / "before.pth")
    image = scene(64, 90)
    here, there = (RaCo(path).detect(image, 30) for path in (weights, str(tmp_path / "before.pth")))
    np.testing.assert_array_equal(here.xy, there.xy)


def test_the_names_and_widths_of_the_published_file():
    state = RaCoNetwork().state_dict()
    shapes = {key: tuple(value.shape) for key, value in state.items()}
    assert shapes["block1.conv1.weight"] == (16, 3, 3, 3)
    assert "block1.match_dims.weight" not in shapes
    assert shapes["block2.match_dims.bias"] == (32,)
    assert shapes["block4.bn2.running_var"] == (128,)
    assert [shapes[f"conv{level}.weight"] for level in (1, 2, 3, 4)] == [
        (32, 16, 1, 1), (32, 32, 3, 3), (32, 64, 3, 3), (32, 128, 3, 3)
    ]  # fmt: skip
    assert [shapes[f"score_head.{i}.weight"] for i in (0, 2, 4, 6)] == [
        (8, 128, 1, 1), (4, 8, 3, 3), (4, 4, 3, 3), (1, 4, 3, 3)
    ]  # fmt: skip
    assert shapes["ranker_head.0.match_dims.weight"] == (12, 3, 1, 1)
    assert shapes["ranker_head.8.conv2.weight"] == (12, 12, 3, 3)
    assert shapes["ranker_head.9.weight"] == (1, 12, 5, 5)
    assert shapes["ranker_head.9.bias"] == (1,)
    assert not {"conv1.bias", "score_head.0.bias", "block1.conv1.bias"} & set(shapes)


class Maps(torch.nn.Module):
    """In place of the network: logits and ranks of given pixels (x, y), elsewhere 0."""

    def __init__(self, logits, ranks):
        super().__init__()
        self.given, self.seen = (logits, ranks), []

    def forward(self, image):
        self.seen.append(image)
        maps = torch.zeros(2, 1, 1, *image.shape[2:])
        for map_, given in zip(maps, self.given, strict=True):
            for (x, y), height in given.items():
                map_[0, 0, y, x] = height
        return tuple(maps)


def with_maps(weights, logits, ranks, **arguments) -> RaCo:
    detector = RaCo(weights, **arguments)
    detector.network = Maps(logits, ranks)
    return detector


HIGH = {(13, 20): 30.0, (14, 20): 10.0, (60, 51): 40.0, (80, 30): 20.0, (0, 59): 25.0}
RANKS = {(13, 20): 3.0, (60, 51): -2.0, (80, 30): 7.0, (0, 59): 1.0}


def test_the_ranker_orders_the_best_detections(weights):
    """The flat rest is full of maxima, too: only the candidates are ranked."""
    detector = with_maps(weights, HIGH, RANKS, candidates=4)
    found = detector.detect(scene(60, 81), 9)
    np.testing.assert_allclose(found.xy, [[80, 30], [13, 20], [0, 59], [60, 51]], atol=1e-6)
    np.testing.assert_allclose(found.score, [7, 3, 1, -2], atol=1e-5)
    np.testing.assert_allclose(detector.detect(scene(60, 81), 2).xy, [[80, 30], [13, 20]], atol=1e-6)
    fewer = with_maps(weights, HIGH, RANKS, candidates=3).detect(scene(60, 81), 9)
    np.testing.assert_allclose(fewer.xy, [[13, 20], [0, 59], [60, 51]], atol=1e-6)
    assert detector.network.seen[0].shape == (1, 3, 60, 81)


def test_without_the_ranker_probabilities_order(weights):
    found = with_maps(weights, HIGH, RANKS, ranker=False).detect(scene(60, 81), 4)
    np.testing.assert_allclose(found.xy, [[60, 51], [13, 20], [0, 59], [80, 30]], atol=1e-6)
    np.testing.assert_allclose(found.score, np.exp([0, -10, -15, -20]), rtol=1e-3)


def test_offsets_are_the_mean_of_nine_pixels_by_softmax():
    logits = torch.zeros(5, 6)
    logits[2, 3], logits[2, 4], logits[3, 3] = 3.0, 2.0, 1.0
    weights = {(0, 0): np.exp(6), (1, 0): np.exp(4), (0, 1): np.exp(2)}
    total = sum(weights.values()) + 6
    # of the six others two are on the right, three on the left; two below, three above
    expected = [(weights[1, 0] + 2 - 3) / total, (weights[0, 1] + 2 - 3) / total]
    found = softmax_offsets(logits, torch.tensor([3]), torch.tensor([2]))
    np.testing.assert_allclose(found, [expected], rtol=1e-5)


def test_beyond_the_border_logits_are_0():
    """Of a map of -1, on its left border, in its upper right corner, and inside: 3, 5 and 0 of 9 pixels are beyond."""
    found = softmax_offsets(torch.full((4, 4), -1.0), torch.tensor([0, 3, 2]), torch.tensor([2, 0, 2]))
    low = np.exp(-2)
    left, corner = (3 * low - 3) / (3 + 6 * low), (2 - 2 * low) / (5 + 4 * low)
    np.testing.assert_allclose(found, [[left, 0], [corner, -corner], [0, 0]], atol=1e-6)


def test_maps_are_sampled_linearly_between_the_centres_of_pixels():
    y, x = torch.meshgrid(torch.arange(5.0), torch.arange(7.0), indexing="ij")
    xy = torch.tensor([[0.0, 0], [6, 4], [2.25, 3.5], [-0.4, 2], [6.3, 4.2]])
    np.testing.assert_allclose(sample_pixels(x, xy), [0, 6, 2.25, 0, 6], atol=1e-5)
    np.testing.assert_allclose(sample_pixels(y, xy), [0, 4, 3.5, 2, 4], atol=1e-5)


@torch.inference_mode()
def test_the_border_is_repeated_on_both_sides_up_to_multiples_of_32(weights):
    network = RaCo(weights).network
    image = torch.from_numpy(scene(60, 81)).float().expand(1, 3, -1, -1) / 255
    padded = torch.nn.functional.pad(image, (7, 8, 2, 2), mode="replicate")
    for cut, whole in zip(network(image), network(padded), strict=True):
        torch.testing.assert_close(cut, whole[..., 2:-2, 7:-8])


def test_levels_are_enlarged_so_that_corner_pixels_coincide():
    """Each level is a ramp of its own columns: enlarged, it is linear from the first to the last."""
    network = RaCoNetwork()
    for level in range(1, 5):
        network.add_module(f"block{level}", torch.nn.Identity())
        network.add_module(f"conv{level}", Columns())
    levels = network._pyramid(torch.zeros(1, 1, 64, 96))[0, :, 5]
    for row, pooled in zip(levels / torch.nn.functional.selu(torch.ones(1)), (1, 2, 8, 32), strict=True):
        torch.testing.assert_close(row, torch.linspace(0, 96 // pooled - 1, 96), atol=1e-4, rtol=0)


class Columns(torch.nn.Module):
    def forward(self, x):
        return torch.arange(x.shape[3]).to(x).expand(x.shape)
