import cv2
import numpy as np
import pytest
import torch
from textured_scenes import flight, texture
from tiny_network import tiny_detector

from sips_lit.errors import BadInputError
from sips_lit.formats.vismatch import SipsMatcher
from sips_lit.geometry.projection import apply_homography

SCENE = flight(2, size=(200, 160))
KEYS = {"num_inliers", "H", "matched_confidences"} | {
    f"{kind}{side}" for kind in ("all_kpts", "all_desc", "matched_kpts", "inlier_kpts") for side in (0, 1)
}  # what vismatch 1.4 documents


def colour(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(image).expand(3, -1, -1) / 255


@pytest.fixture(scope="module")
def matcher() -> SipsMatcher:
    return SipsMatcher(tiny_detector(), n=200)


def test_two_images(matcher):
    result = matcher(*map(colour, SCENE.frames))
    assert result.keys() == KEYS
    true = SCENE.homography(0, 1)
    corners = np.array([[0, 0], [199, 0], [199, 159], [0, 159]], float)
    assert np.abs(apply_homography(result["H"], corners) - apply_homography(true, corners)).max() < 2
    assert result["num_inliers"] == len(result["inlier_kpts0"]) == len(result["inlier_kpts1"]) > 10
    error = np.linalg.norm(apply_homography(true, result["inlier_kpts0"]) - result["inlier_kpts1"], axis=1)
    assert np.median(error) < 1
    assert len(result["matched_kpts0"]) == len(result["matched_kpts1"]) == len(result["matched_confidences"])
    assert result["all_desc0"].shape == (len(result["all_kpts0"]), 128)
    points = matcher.detector(SCENE.frames[0], 200)
    np.testing.assert_array_equal(result["all_kpts0"], points.xy)
    assert np.all((result["matched_confidences"] > 0) & (result["matched_confidences"] < 1))


def test_every_kind_of_image_gives_the_same(matcher, tmp_path):
    image = np.dstack([texture(50, 70, seed) for seed in range(3)])
    path = tmp_path / "image.png"
    cv2.imwrite(str(path), image[:, :, ::-1])
    loaded = matcher.load_image(path)
    np.testing.assert_allclose(loaded.numpy(), image.transpose(2, 0, 1) / np.float32(255), rtol=1e-6)
    expected = matcher.extract(path)
    assert expected.keys() == {"all_kpts0", "all_desc0"}
    for given in (loaded, loaded.numpy(), str(path)):
        found = matcher.extract(given)
        assert all(np.array_equal(found[key], expected[key]) for key in expected)


def test_blank_images(matcher):
    blank = torch.zeros(3, 40, 50)
    result = matcher(blank, colour(SCENE.frames[0]))
    assert result.keys() == KEYS
    assert result["H"] is None
    assert result["num_inliers"] == 0
    assert result["inlier_kpts0"].shape == (0, 2)
    none = SipsMatcher(tiny_detector(), n=0)(blank, blank)
    assert none["matched_kpts0"].shape == (0, 2)
    assert none["all_desc1"].shape == (0, 128)
    with pytest.raises(BadInputError, match="from nan"):
        matcher(blank * torch.nan, blank)


def test_what_it_is_called(matcher):
    assert matcher.name == "SIPs + RootSIFT"
