import numpy as np
import pytest
import torch
from detector_contract import check_contract, scene
from random_weights import rpautrat_name, weights_file

from sips_lit.baselines.superpoint import (
    SuperPoint,
    SuperPointNetwork,
    decode,
    greedy_maxima,
    is_rpautrat,
    sample_cells,
    to_our_names,
)
from sips_lit.errors import BadInputError


@pytest.mark.parametrize(
    ("layout", "name"), [("superpoint", "SuperPoint"), ("superpoint_rpautrat", "SuperPoint (rpautrat)")]
)
def test_contract_with_random_weights_of_both_layouts(layout, name, tmp_path):
    detector = SuperPoint(str(weights_file(layout, tmp_path)))
    assert detector.name == name
    check_contract(detector, 256)


def test_both_layouts_load_the_same_convolutions(tmp_path):
    theirs = torch.load(weights_file("superpoint_rpautrat", tmp_path), weights_only=True)
    network = SuperPoint(str(tmp_path / "superpoint_rpautrat.pth")).network
    torch.testing.assert_close(network.get_submodule("conv2b").weight, theirs["backbone.1.1.conv.weight"])
    torch.testing.assert_close(network.get_submodule("bnDb").running_var, theirs["descriptor.1.bn.running_var"])


def test_decoding_by_hand():
    """Two cells side by side; the logit of channel c is that of pixel (c % 8, c // 8), the last one of no point."""
    logits = torch.zeros(1, 65, 1, 2)
    logits[0, 3 * 8 + 5, 0, 0] = np.log(36)  # 36 against 63 + 1 ones
    logits[0, 64, 0, 1] = np.log(136)  # the dustbin: 64 ones against 136
    scores = decode(logits)[0].numpy()
    assert scores.shape == (8, 16)
    expected = np.full((8, 16), 0.01)
    expected[3, 5] = 0.36
    expected[:, 8:] = 1 / 200
    np.testing.assert_allclose(scores, expected, rtol=1e-5)


def test_suppression_by_hand():
    """A chain: the middle one goes, and then the last one stays, as it is worse only than what is gone."""
    scores = np.zeros((20, 40), np.float32)
    scores[10, 10], scores[10, 13], scores[10, 16] = 0.9, 0.8, 0.7
    assert greedy_maxima(scores, 4, 0, 0.1, 9).tolist() == [[10, 10], [16, 10]]
    assert greedy_maxima(scores, 2, 0, 0.1, 9).tolist() == [[10, 10], [13, 10], [16, 10]]
    assert greedy_maxima(scores, 4, 0, 0.75, 9).tolist() == [[10, 10]]
    assert greedy_maxima(scores, 4, 0, 0.1, 1).tolist() == [[10, 10]]


def test_points_at_the_border_suppress_but_are_not_given():
    scores = np.zeros((20, 40), np.float32)
    scores[3, 10], scores[4, 12], scores[15, 35] = 0.9, 0.8, 0.7
    assert greedy_maxima(scores, 4, 4, 0.1, 9).tolist() == [[35, 15]]
    assert greedy_maxima(scores, 1, 4, 0.1, 9).tolist() == [[12, 4], [35, 15]]


def test_suppression_leaves_no_two_near_and_none_out():
    scores = np.random.default_rng(0).random((40, 50)).astype(np.float32)
    kept = greedy_maxima(scores, 3, 0, 0.2, 10_000)
    apart = np.abs(kept[:, None] - kept).max(axis=2)
    np.fill_diagonal(apart, 99)
    assert apart.min() > 3
    pixels = np.argwhere(scores > 0.2)[:, ::-1]
    reach = np.abs(pixels[:, None] - kept).max(axis=2) <= 3
    better = scores[kept[:, 1], kept[:, 0]] >= scores[pixels[:, 1], pixels[:, 0]][:, None]
    assert (reach & better).any(axis=1).all()


def test_sampling_is_linear_between_the_centres_of_cells():
    columns, rows = torch.arange(5.0).expand(3, 5), torch.arange(3.0)[:, None].expand(3, 5)
    dense = torch.stack([columns, rows])[None]
    xy = np.array([[3.5, 3.5], [11.5, 3.5], [7.5, 11.5], [20, 9]], np.float32)
    expected = [[0, 0], [1, 0], [0.5, 1], [16.5 / 8, 5.5 / 8]]
    np.testing.assert_allclose(sample_cells(dense, xy).numpy(), expected, atol=1e-5)


def test_images_of_any_size_keep_their_coordinates(tmp_path):
    """Padding at the right and at the bottom moves nothing far from there."""
    detector = SuperPoint(str(weights_file("superpoint", tmp_path)))
    image = scene(160, 200)
    whole, cut = detector.detect(image, 10_000), detector.detect(np.ascontiguousarray(image[:157, :195]), 10_000)
    inner = {tuple(xy) for xy in whole.xy.tolist() if max(xy) < 60}
    assert len(inner) > 5
    assert inner <= {tuple(xy) for xy in cut.xy.tolist()}


def test_without_weights_it_says_where_to_get_them(tmp_path):
    with pytest.raises(BadInputError, match=r"magicleap.*rpautrat.*detector\.weights"):
        SuperPoint()
    with pytest.raises(BadInputError, match=r"no file of weights .*gone\.pth"):
        SuperPoint(str(tmp_path / "gone.pth"))
    (tmp_path / "damaged.pth").write_bytes(b"PK nonsense")
    with pytest.raises(BadInputError, match=r"damaged\.pth can't be read"):
        SuperPoint(str(tmp_path / "damaged.pth"))
    torch.save({"conv1a.weight": torch.zeros(1)}, tmp_path / "other.pth")
    with pytest.raises(BadInputError, match=r"other\.pth does not hold"):
        SuperPoint(str(tmp_path / "other.pth"))
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(BadInputError, match=r"list\.pth holds a list"):
        SuperPoint(str(tmp_path / "list.pth"))


def test_the_names_of_the_published_files():
    """As the authors' demo and rpautrat/SuperPoint print them."""
    ours = set(SuperPointNetwork(batch_norm=False).state_dict())
    layers = ["1a", "1b", "2a", "2b", "3a", "3b", "4a", "4b", "Pa", "Pb", "Da", "Db"]
    assert ours == {f"conv{layer}.{part}" for layer in layers for part in ("weight", "bias")}
    assert rpautrat_name("conv1a.weight") == "backbone.0.0.conv.weight"
    assert rpautrat_name("bn4b.running_mean") == "backbone.3.1.bn.running_mean"
    assert rpautrat_name("convPb.bias") == "detector.1.conv.bias"
    assert rpautrat_name("bnDa.weight") == "descriptor.0.bn.weight"


def test_widths_are_those_of_the_paper():
    network = SuperPointNetwork(batch_norm=False)
    widths = [network.get_submodule(f"conv{n}").out_channels for n in ("1a", "2a", "3a", "4a", "Pa", "Pb", "Da", "Db")]
    assert widths == [64, 64, 128, 128, 256, 65, 256, 256]
    logits, descriptors = network(torch.rand(1, 1, 24, 40))
    assert (logits.shape, descriptors.shape) == ((1, 65, 3, 5), (1, 256, 3, 5))


def test_names_of_the_other_layout_become_ours():
    weights = SuperPointNetwork(batch_norm=True).state_dict()
    theirs = {rpautrat_name(key): value for key, value in weights.items()}
    assert is_rpautrat(theirs)
    assert not is_rpautrat(weights)
    assert to_our_names(theirs).keys() == to_our_names(weights).keys() == weights.keys()


def test_unknown_names_stay():
    unknown = {
        "backbone.0.2.conv.weight": torch.zeros(1),
        "detector.7.conv.weight": torch.zeros(1),
        "other": torch.zeros(1),
    }
    assert to_our_names(unknown).keys().isdisjoint(SuperPointNetwork(batch_norm=True).state_dict())
