import runpy

import pytest
import torch
from cli_runs import ROOT

from sips_lit.detect.score_network import ScoreNetwork


@pytest.fixture(scope="module")
def plain():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        return runpy.run_path(str(ROOT / "benchmarks" / "runtimes.py"))["plain"]


def test_the_plain_network_is_the_network(plain):
    torch.manual_seed(0)
    network = ScoreNetwork(depth=4, width=8, derivatives=False, octaves=1, corners=0.0)
    image = 255 * torch.rand(1, 1, 21, 30)
    with torch.no_grad():
        torch.testing.assert_close(plain(network)(image), network(image), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("more", [{"derivatives": True}, {"octaves": 2}, {"corners": 0.5}])
def test_no_other_network_is_plain(plain, more):
    with pytest.raises(SystemExit, match="only networks without"):
        plain(ScoreNetwork(**{"depth": 4, "width": 8, "derivatives": False, "octaves": 1, "corners": 0.0, **more}))
