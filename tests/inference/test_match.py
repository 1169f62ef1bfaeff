import cv2
import numpy as np
import PIL.Image
import pytest
import torch
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import texture
from tiny_network import tiny_detector

import sips_lit
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.orb import OrbDescriptor
from sips_lit.detect.checkpoint import export_safetensors
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.geometry.pose import rotation_error
from sips_lit.geometry.projection import apply_homography
from sips_lit.inference.match import PairMatcher, match

SIZE = (320, 240)
IMAGE = texture(SIZE[1], SIZE[0])
H = np.array([[0.97, 0.06, 5], [-0.04, 1.02, -7], [1e-4, 5e-5, 1]])
WARPED = cv2.warpPerspective(IMAGE, H, SIZE, flags=cv2.INTER_CUBIC)
CORNERS = np.array([[0, 0], [319, 0], [319, 239], [0, 239]], float)
BLANK = np.full((60, 80), 128, np.uint8)


def same(a, b) -> None:
    np.testing.assert_array_equal(a.xy0, b.xy0)
    np.testing.assert_array_equal(a.xy1, b.xy1)
    np.testing.assert_array_equal(a.confidence, b.confidence)
    np.testing.assert_array_equal(a.inlier, b.inlier)
    for x, y in ((a.homography, b.homography), (a.T_1_0, b.T_1_0)):
        assert (x is None) == (y is None)
        if x is not None:
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    "detector",
    ["sips-small", "sips-tiny", SiftDetector(), ShiTomasi()],
    ids=["sips-small", "sips-tiny", "sift", "shi_tomasi"],
)
def test_a_known_homography(detector):
    found = match(IMAGE, WARPED, detector=detector)
    assert np.abs(apply_homography(found.homography, CORNERS) - apply_homography(H, CORNERS)).max() < 1
    near = np.linalg.norm(apply_homography(H, found.xy0) - found.xy1, axis=1)
    assert near[found.inlier].max() < 4
    assert found.inlier.sum() > 40
    assert found.T_1_0 is None
    assert found.confidence.shape == (len(found),)
    assert np.all((found.confidence >= 0) & (found.confidence <= 1))
    assert found.confidence[found.inlier].mean() > found.confidence[~found.inlier].mean()
    swapped = apply_homography(H, found.xy0[:, ::-1])
    assert np.median(np.linalg.norm(swapped - found.xy1, axis=1)) > 10, "x and y are told apart"


def test_a_known_pose():
    scene = StereoScene(4)
    T = np.linalg.inv(scene.pose(3)) @ scene.pose(0)
    truth = T[:3, 3] / np.linalg.norm(T[:3, 3])
    for camera in (CAMERA, CAMERA.matrix, [CAMERA, CAMERA.matrix]):
        found = match(scene.frame(0), scene.frame(3), camera=camera)
        assert found.homography is None
        assert rotation_error(found.T_1_0, T) < 0.5
        assert np.degrees(np.arccos(found.t @ truth)) < 5
        assert found.inlier.sum() > 30
    with pytest.raises(BadInputError, match=r"not of shape \(4, 4\)"):
        match(IMAGE, WARPED, camera=np.eye(4))


def test_the_same_input_gives_the_same_result(tmp_path):
    files = [tmp_path / name for name in ("a.png", "b.png")]
    for file, image in zip(files, (IMAGE, WARPED), strict=True):
        cv2.imwrite(str(file), image)
    expected = match(*files, n=100)
    assert len(expected.keypoints0) == 100
    same(match(IMAGE, WARPED, n=100), expected)
    same(match(PIL.Image.fromarray(IMAGE), torch.from_numpy(WARPED), n=100), expected)
    same(match(str(files[0]), files[1], n=100, detector=SipsDetector.from_pretrained()), expected)
    same(match(str(files[0]), files[1], n=100, detector="sips-tiny"), expected)


def test_a_pose_is_stricter_than_a_homography():
    scene = StereoScene(4)
    images, one, three = (scene.frame(0), scene.frame(3)), {"threshold": 1.0}, {"threshold": 3.0}
    same(match(*images, camera=CAMERA), match(*images, camera=CAMERA, **one))
    same(match(*images), match(*images, **three))
    assert not np.array_equal(match(*images, **one).inlier, match(*images, **three).inlier)
    assert not np.array_equal(match(*images, camera=CAMERA).inlier, match(*images, camera=CAMERA, **three).inlier)


def test_a_checkpoint_and_a_descriptor_of_ones_own(tmp_path):
    detector = tiny_detector()
    export_safetensors(detector.network, detector.selector, tmp_path / "tiny.safetensors")
    same(match(IMAGE, WARPED, detector=tmp_path / "tiny.safetensors"), match(IMAGE, WARPED, detector=detector))
    orb = match(IMAGE, WARPED, detector=detector, descriptor=OrbDescriptor())
    assert not np.array_equal(orb.matches.index1, match(IMAGE, WARPED, detector=detector).matches.index1)
    with pytest.raises(BadInputError, match="does not describe them"):
        PairMatcher(detector, None).view(IMAGE)


def test_a_detector_with_descriptors_of_its_own_uses_them():
    sift = SiftDetector()
    expected = PairMatcher(sift, None, 100)
    same(match(IMAGE, WARPED, 100, sift), expected.join(expected.view(IMAGE), expected.view(WARPED)))


def test_colours_of_opencv():
    rgb = np.dstack([texture(120, 160, seed) for seed in (1, 2, 3)])
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    expected = match(rgb, rgb, n=50)
    same(match(bgr, bgr, n=50, color="bgr"), expected)
    assert not np.array_equal(match(bgr, bgr, n=50).xy0, expected.xy0)
    np.testing.assert_array_equal(match(bgr, bgr, color="bgr").image0, cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))


def test_the_same_image_twice():
    found = match(IMAGE, IMAGE, n=100)
    np.testing.assert_array_equal(found.xy0, found.xy1)
    np.testing.assert_allclose(found.homography, np.eye(3), atol=1e-6)
    assert found.inlier.all()
    posed = match(IMAGE, IMAGE, n=100, camera=CAMERA)
    np.testing.assert_allclose(posed.R, np.eye(3), atol=1e-6)
    np.testing.assert_array_equal(posed.t, 0)


@pytest.mark.parametrize("camera", [None, np.array([[80.0, 0, 40], [0, 80, 30], [0, 0, 1]])])
@pytest.mark.parametrize("other", [BLANK, texture(60, 80), texture(1, 1), texture(3, 90)])
def test_images_with_nothing_to_match(other, camera):
    cameras = None if camera is None or other.shape != BLANK.shape else camera
    for images in ((BLANK, other), (other, BLANK)):
        found = match(*images, camera=cameras)
        assert found.xy0.shape == found.xy1.shape == (len(found), 2)
        assert found.confidence.shape == found.inlier.shape == (len(found),)
        assert found.picture().shape[2] == 3
        assert found.inlier.sum() < 12
        assert (found.homography is None and found.T_1_0 is None) == found.model.startswith("no ")


def test_no_points():
    found = match(IMAGE, WARPED, n=0)
    assert len(found) == 0
    assert found.model == "no homography: 0 of 4 matches that it needs"


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"n": -1}, "n is -1"),
        ({"threshold": 0}, "threshold is 0"),
        ({"threshold": float("nan")}, "threshold is nan"),
        ({"detector": "sips-huge"}, "there is no checkpoint sips-huge"),
        ({"color": "grb"}, "color is grb"),
    ],
)
def test_what_cannot_be(keys, reason):
    with pytest.raises(BadInputError, match=reason):
        match(IMAGE, WARPED, **keys)


def test_a_missing_file_is_named(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), IMAGE)
    with pytest.raises(BadInputError, match=r"cannot read the image .*b\.png"):
        match(tmp_path / "a.png", tmp_path / "b.png")


def test_it_is_public():
    assert sips_lit.match is match
