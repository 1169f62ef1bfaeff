"""A sequence made from records, without the layout of any data set: what it derives from them is checked by rendering."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rgbd_files import matrix, pose, render, write_image

from sips_lit.datasets.rgbd_sequence import RgbdFrames, RgbdSequence, read_depth_image, to_metres, undistortion
from sips_lit.errors import BadInputError
from sips_lit.types import Camera

SIZE = (160, 120)
K = matrix(130.0, 131.0, 79.0, 60.0)
LENS = (0.26, -0.9, -0.005, 0.003, 1.1)
UNIT = 0.001
HALF_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


def frames_in(folder, lens=None, count=3) -> RgbdFrames:
    """Of a slanted wall; the last frame has neither depth nor pose."""
    images, depths = [], []
    for i in range(count):
        image, depth = render(i, K, SIZE, lens)
        images.append(folder / f"{i}.png")
        depths.append(folder / "depth" / f"{i}.png")
        write_image(images[-1], image)
        write_image(depths[-1], np.round(depth / UNIT).astype(np.uint16))
    poses = [pose(i) for i in range(count - 1)]
    return RgbdFrames(images, [*depths[:-1], None], [*poses, None], [0.1, 0.2, 0.4], Camera(K, SIZE), lens, UNIT, [])


def test_frames_as_they_are_recorded(tmp_path):
    sequence = RgbdSequence(tmp_path, "desk one", frames_in(tmp_path))
    assert (sequence.name, len(sequence), sequence.frame_name(1)) == ("desk_one", 3, "desk_one_1")
    for i in range(2):
        image, depth = render(i, K, SIZE)
        np.testing.assert_array_equal(sequence.frame(i), image)
        np.testing.assert_allclose(sequence.depth(i), depth, atol=UNIT)
        np.testing.assert_array_equal(sequence.pose(i), pose(i))
    assert (sequence.depth(2), sequence.pose(2)) == (None, None)
    assert [sequence.time(i) for i in range(3)] == [0.1, 0.2, 0.4]
    np.testing.assert_array_equal(sequence.camera(0).matrix, K)


def test_no_times(tmp_path):
    assert RgbdSequence(tmp_path, "desk", replace(frames_in(tmp_path), times=None)).time(0) is None


def test_a_pixel_without_depth_is_nan_also_where_images_are_shrunk(tmp_path):
    frames = frames_in(tmp_path)
    stored = np.full(SIZE[::-1], 2000, np.uint16)
    stored[:60] = 0  # the upper half
    write_image(frames.depths[0], stored)
    for max_side in (None, 80):
        depth = RgbdSequence(tmp_path, "desk", frames, max_side).depth(0)
        half = len(depth) // 2
        assert np.isnan(depth[:half]).all()
        np.testing.assert_allclose(depth[half:], 2, rtol=1e-6)


@pytest.mark.parametrize(("lens", "max_side"), [(LENS, None), (None, 60), (LENS, 60)])
def test_no_depth_between_foreground_and_background(tmp_path, lens, max_side):
    frames = frames_in(tmp_path, lens)
    stored = np.full(SIZE[::-1], 1000, np.uint16)
    stored[:, np.arange(SIZE[0]) // 7 % 2 == 1] = 3000  # stripes
    write_image(frames.depths[0], stored)
    depth = RgbdSequence(tmp_path, "desk", frames, max_side).depth(0)
    assert set(np.unique(depth)) == {np.float32(1), 3000 * np.float32(UNIT)}
    assert np.mean(depth < 2) == pytest.approx(np.mean(stored < 2000), abs=0.05)


@pytest.mark.parametrize("max_side", [None, 80])
def test_a_bent_image_becomes_what_its_pinhole_camera_would_see(tmp_path, max_side):
    sequence = RgbdSequence(tmp_path, "desk", frames_in(tmp_path, LENS), max_side)
    camera = sequence.camera(0)
    assert camera.size == ((80, 60) if max_side else SIZE)
    truth = averaged(camera)
    assert difference(sequence.frame(0), truth) < 4
    assert difference(cv2.resize(render(0, K, SIZE, LENS)[0], camera.size, interpolation=cv2.INTER_AREA), truth) > 20
    np.testing.assert_allclose(sequence.depth(0), render(0, camera.matrix, camera.size)[1], atol=0.02)


def averaged(camera: Camera) -> np.ndarray:
    """Frame 0 of a pinhole camera whose pixels average what falls onto them: rendered four times as large, then shrunk."""
    fine = np.diag([4, 4, 1]) @ (camera.matrix + HALF_PIXEL) - HALF_PIXEL
    image, _ = render(0, fine, (4 * camera.size[0], 4 * camera.size[1]))
    return cv2.resize(image, camera.size, interpolation=cv2.INTER_AREA)


def difference(image0: np.ndarray, image1: np.ndarray) -> float:
    """Mean difference in grey values."""
    return float(np.abs(image0.astype(float) - image1).mean())


def test_places_in_the_stored_image_are_those_of_the_lens_equations():
    camera, (x, y) = undistortion(Camera(K, SIZE), LENS)
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    a, b = (u - camera.matrix[0, 2]) / camera.matrix[0, 0], (v - camera.matrix[1, 2]) / camera.matrix[1, 1]
    k1, k2, p1, p2, k3 = LENS
    r2 = a * a + b * b
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent_a = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)
    bent_b = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b
    np.testing.assert_allclose(x, K[0, 0] * bent_a + K[0, 2], atol=2e-3)
    np.testing.assert_allclose(y, K[1, 1] * bent_b + K[1, 2], atol=2e-3)
    assert x.min() > -1  # it sees no more than what is stored
    assert x.max() < SIZE[0]


def test_no_lens_distortion_moves_nothing():
    camera, (x, y) = undistortion(Camera(K, SIZE), (0.0,) * 5)
    np.testing.assert_allclose(x, x[:1].repeat(SIZE[1], 0), atol=1e-4)
    assert (np.diff(y, axis=0) > 0).all()
    assert camera.size == SIZE


def test_images_of_another_size_than_the_camera(tmp_path):
    frames = frames_in(tmp_path)
    wide = replace(frames, camera=Camera(K, (320, 240)))
    with pytest.raises(BadInputError, match=r"0\.png is 160x120, but its camera is for 320x240"):
        RgbdSequence(tmp_path, "desk", wide).frame(0)
    write_image(frames.depths[1], np.ones((60, 80), np.uint16))
    with pytest.raises(BadInputError, match=r"1\.png is 80x60, but its image is 160x120"):
        RgbdSequence(tmp_path, "desk", frames).depth(1)


def test_the_fingerprint_is_of_all_that_makes_the_frames(tmp_path):
    frames = frames_in(tmp_path)
    (tmp_path / "poses.txt").write_text("1")
    variants = [
        frames,
        replace(frames, camera=Camera(K * 1.01, SIZE)),
        replace(frames, distortion=LENS),
        replace(frames, depths=[None, *frames.depths[1:]]),
        replace(frames, poses=[None, *frames.poses[1:]]),
        replace(frames, images=frames.images[:2], depths=frames.depths[:2], poses=frames.poses[:2]),
        replace(frames, tables=[tmp_path / "poses.txt"]),
    ]
    prints = [RgbdSequence(tmp_path, "desk", variant).fingerprint for variant in variants]
    prints.append(RgbdSequence(tmp_path, "desk", frames, 80).fingerprint)
    assert len(set(prints)) == len(prints)
    assert RgbdSequence(tmp_path, "desk", frames).fingerprint == prints[0]
    cv2.imwrite(str(frames.depths[0]), np.ones((7, 9), np.uint16))
    assert RgbdSequence(tmp_path, "desk", frames).fingerprint != prints[0]


def test_steps_become_metres_and_zero_is_unknown(tmp_path):
    stored = np.array([[0, 1, 5000], [65535, 2500, 0]], np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), stored)
    depth = to_metres(read_depth_image(tmp_path / "a.png", (3, 2)), 1 / 5000)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, [[np.nan, 2e-4, 1], [13.107, 0.5, np.nan]], rtol=1e-6)


def test_no_depth_map(tmp_path):
    with pytest.raises(BadInputError, match=r"cannot read the image .*a\.png"):
        read_depth_image(tmp_path / "a.png", (3, 2))
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(BadInputError, match=r"a\.png is not an image"):
        read_depth_image(tmp_path / "a.png", (3, 2))
    cv2.imwrite(str(tmp_path / "a.png"), np.ones((2, 3, 3), np.uint16))
    with pytest.raises(BadInputError, match="grey 16-bit"):
        read_depth_image(tmp_path / "a.png", (3, 2))
    cv2.imwrite(str(tmp_path / "a.png"), np.ones((3, 2), np.uint16))
    with pytest.raises(BadInputError, match="is 2x3, but its image is 3x2"):
        read_depth_image(tmp_path / "a.png", (3, 2))
