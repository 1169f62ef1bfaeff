import pytest
import torch

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.export.logits import LogitsOfImage


@pytest.mark.parametrize(
    "options",
    [
        {"width": 8, "derivatives": True, "octaves": 2, "corners": 0.5},
        {"width": 10, "octaves": 2, "first_octave": 0.5, "octave_step": 0.5},
        {"width": 8, "derivatives": True, "first_octave": 1, "corners": 0.5, "fine_corners": 0.25},
        {"width": 4},
        {"width": 10},
    ],
)
@pytest.mark.parametrize("shape", [(1, 1, 48, 64), (2, 1, 47, 61), (1, 1, 5, 3), (1, 1, 1, 1)])
def test_they_are_those_of_the_network(options, shape):
    torch.manual_seed(0)
    network = ScoreNetwork(depth=4, **options).eval()
    image = torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(1)).float()
    with torch.no_grad():
        expected, found = network(image), LogitsOfImage(network)(image)
    assert expected.numel() == 1 or expected.std() > 1e-3
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)


def test_a_graph_of_a_narrow_network_is_on_blocks_with_weights_made_beforehand():
    network = ScoreNetwork(depth=4, width=8, derivatives=True).eval().requires_grad_(False)
    program = torch.export.export(LogitsOfImage(network), (torch.zeros(1, 1, 20, 24),))
    parts = [part for part in program.graph_module.modules() if isinstance(part, torch.fx.GraphModule)]
    operations = [str(node.target) for part in parts for node in part.graph.nodes if node.op == "call_function"]
    assert operations.count("aten.conv2d.default") == 5  # filters and four layers
    assert "aten.pixel_shuffle.default" in operations
    made = [name for name in operations if "repeat_interleave" in name or "permute" in name or "stack" in name]
    assert not made
