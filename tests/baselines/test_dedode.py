import numpy as np
import pytest
import torch
from detector_contract import check_contract, scene
from learned_baselines import check_no_gradients
from random_weights import weights_file

from sips_lit.baselines.dedode import Dedode
from sips_lit.errors import BadInputError


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dedode")
    return [str(weights_file(name, folder)) for name in ("dedode", "dedode_descriptor")]


@pytest.fixture(scope="module")
def detector(files):
    return Dedode(*files)


@pytest.mark.slow
def test_contract_with_random_weights(detector, files):
    check_contract(detector, 256)
    check_no_gradients(detector)
    alone = Dedode(files[0])
    assert not alone.describes
    image = scene(40, 60)
    np.testing.assert_array_equal(alone.detect(image, 9).xy, detector.detect(image, 9).xy)
    with pytest.raises(TypeError, match="DeDoDe"):
        alone.detect_and_describe(image, 9)


def test_missing_weights_are_refused(tmp_path):
    with pytest.raises(BadInputError, match=r"in no package: download .*Parskatt/DeDoDe .*detector\.weights"):
        Dedode()
    pytest.importorskip("kornia.feature", reason="kornia is missing: pip install 'sips_lit[baselines]'")
    with pytest.raises(BadInputError, match=r"no file of weights .*gone\.pth"):
        Dedode(str(tmp_path / "gone.pth"))


@pytest.mark.slow
def test_other_weights_are_refused(files):
    with pytest.raises(BadInputError, match="does not hold the weights of DeDoDe's detector"):
        Dedode(files[1])
    with pytest.raises(BadInputError, match="does not hold the weights of DeDoDe's descriptor B"):
        Dedode(files[0], descriptor=files[0])


class Peaks(torch.nn.Module):
    """In place of the detector's network: logits of given pixels (x, y), 0 elsewhere."""

    def __init__(self, peaks):
        super().__init__()
        self.peaks, self.seen = peaks, []

    def forward(self, image):
        self.seen.append(image)
        logits = torch.zeros(1, 1, *image.shape[2:])
        for x, y, height in self.peaks:
            logits[0, 0, y, x] = height
        return logits


def test_points_are_the_peaks_without_their_neighbours(detector, monkeypatch):
    """Of 60 x 81 pixels, padded to 70 x 84: a peak in the padding is no point."""
    peaks = Peaks([(13, 20, 9.0), (14, 20, 8.9), (60, 51, 8.0), (82, 30, 30.0)])
    monkeypatch.setitem(detector.network._modules, "detector", peaks)
    image = scene(60, 81)
    np.testing.assert_array_equal(detector.detect(image, 2).xy, [[13, 20], [60, 51]])
    assert peaks.seen[0].shape == (1, 3, 70, 84)
    monkeypatch.setattr(detector, "nms_radius", 0)
    np.testing.assert_array_equal(detector.detect(image, 3).xy, [[13, 20], [14, 20], [60, 51]])


class Ramp(torch.nn.Module):
    """In place of the descriptor's network: each pixel's column and row, then 1."""

    def forward(self, image):
        height, width = image.shape[2:]
        y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        return torch.stack([x, y, torch.ones_like(x)]).float()[None]


def test_descriptors_are_read_at_their_pixel(detector, monkeypatch):
    monkeypatch.setitem(detector.network._modules, "detector", Peaks([(13, 20, 9.0), (60, 51, 8.0)]))
    monkeypatch.setitem(detector.network._modules, "descriptor", Ramp())
    found = detector.detect_and_describe(scene(60, 81), 2)
    read = found.descriptors[:, :2] / found.descriptors[:, 2:]
    np.testing.assert_allclose(read, found.keypoints.xy, atol=1e-3)
