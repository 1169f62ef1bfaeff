import torch
from random_weights import rpautrat_name

from sips_lit.baselines.superpoint_network import SuperPointNetwork, is_rpautrat, to_our_names


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
