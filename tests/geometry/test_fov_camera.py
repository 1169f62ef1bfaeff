import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.errors import BadInputError
from sips_lit.geometry.fov_camera import FovCamera, Rectification, crop_camera, full_camera
from sips_lit.types import Camera


def narrow(size: tuple[int, int] = (128, 102), omega: float = 0.92, cx: float = 0.49, cy: float = 0.51) -> FovCamera:
    """About the narrow lens of TUM mono, with a smaller image: 0.54, 0.67, 0.49, 0.51 relative to its size."""
    w, h = size
    matrix = np.array([[0.54 * w, 0, cx * w - 0.5], [0, 0.67 * h, cy * h - 0.5], [0, 0, 1]])
    return FovCamera(matrix, omega, size)


def wide() -> FovCamera:
    """About its wide lens: the corners are more than 90 degrees off the axis."""
    return FovCamera(np.array([[44.7, 0, 62.2], [0, 44.6, 50.8], [0, 0, 1]]), 0.93, (128, 102))


def distort_by_angles(camera: FovCamera, x: float, y: float) -> tuple[float, float]:
    """The model by its own words: keep the direction, change the distance from the axis."""
    direction, distance = math.atan2(y, x), math.hypot(x, y)
    if camera.omega > 0:
        distance = math.atan(2 * distance * math.tan(camera.omega / 2)) / camera.omega
    u, v = distance * math.cos(direction), distance * math.sin(direction)
    return camera.matrix[0, 0] * u + camera.matrix[0, 2], camera.matrix[1, 1] * v + camera.matrix[1, 2]


@pytest.mark.parametrize("omega", [0.0, 1e-3, 0.92, 2.5])
def test_distortion_as_the_model_says(omega: float):
    camera = narrow(omega=omega)
    points = np.random.default_rng(0).normal(0, 2, (50, 2))
    expected = [distort_by_angles(camera, x, y) for x, y in points]
    np.testing.assert_allclose(camera.distort(points), expected, rtol=1e-12, atol=1e-9)


def test_a_known_point():
    # omega = 60 degrees: tan(omega / 2) = 1 / sqrt(3); r = sqrt(3) / 2 has atan(1) = 45 degrees, so 3/4
    camera = FovCamera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), math.pi / 3, (101, 81))
    np.testing.assert_allclose(camera.distort(np.array([[math.sqrt(3) / 2, 0]])), [[125, 40]])


@given(
    x=st.floats(-20, 20),
    y=st.floats(-20, 20),
    omega=st.one_of(st.just(0.0), st.floats(1e-4, 3)),
    cx=st.floats(0.3, 0.7),
)
@settings(max_examples=200, deadline=None)
def test_undistort_inverts_distort(x: float, y: float, omega: float, cx: float):
    camera = narrow(omega=omega, cx=cx)
    pixels = camera.distort(np.array([[x, y]]))
    np.testing.assert_allclose(camera.distort(camera.undistort(pixels)), pixels, atol=1e-6)
    np.testing.assert_allclose(camera.undistort(pixels), [[x, y]], rtol=1e-6, atol=1e-6)


def test_the_centre_and_no_points():
    camera = narrow()
    centre = camera.matrix[:2, 2][None]
    np.testing.assert_array_equal(camera.distort(np.zeros((1, 2))), centre)
    np.testing.assert_array_equal(camera.undistort(centre), np.zeros((1, 2)))
    assert camera.distort(np.zeros((0, 2))).shape == camera.undistort(np.zeros((0, 2))).shape == (0, 2)


def test_rays_beside_the_camera_are_not_a_number():
    camera = wide()
    undistorted = camera.undistort(np.array([[0, 0], [127, 0], [127, 101], [0, 51], [62, 51]]))
    np.testing.assert_array_equal(np.isnan(undistorted[:, 0]), [True, True, True, False, False])


def reaches(camera: FovCamera, to: Camera) -> np.ndarray:
    """For every pixel of the pinhole camera, by a slow loop: whether the image reaches there."""
    width, height = to.size
    inside = np.zeros((height, width), bool)
    for row in range(height):
        for column in range(width):
            ray = np.linalg.solve(to.matrix, [column, row, 1.0])
            x, y = distort_by_angles(camera, ray[0], ray[1])
            inside[row, column] = -1e-9 <= x <= camera.size[0] - 1 + 1e-9 and -1e-9 <= y <= camera.size[1] - 1 + 1e-9
    return inside


def grown(camera: Camera, side: int, pixels: float) -> Camera:
    """The camera whose view reaches some pixels further on one side (left, right, top, bottom)."""
    axis, first = side // 2, side % 2 == 0
    matrix, length = camera.matrix.copy(), camera.size[axis] - 1
    scale = length / (length + pixels)
    matrix[axis, axis] *= scale
    matrix[axis, 2] = scale * (matrix[axis, 2] + (pixels if first else 0))
    return Camera(matrix, camera.size)


@pytest.mark.parametrize("camera", [narrow(), wide(), narrow(cx=0.4, cy=0.6), narrow(omega=0.0)])
def test_crop_is_the_largest_rectangle_without_a_border(camera: FovCamera):
    crop = crop_camera(camera, (64, 48))
    assert reaches(camera, crop).all()
    for side in range(4):
        assert not reaches(camera, grown(crop, side, 0.5)).all()
    white = np.full((camera.size[1], camera.size[0]), 255, np.uint8)
    assert Rectification(camera, crop)(white).min() == 255


@pytest.mark.parametrize("camera", [narrow(), narrow(cx=0.4, cy=0.6), narrow(omega=0.0)])
def test_full_shows_every_pixel(camera: FovCamera):
    full = full_camera(camera, (90, 70))
    w, h = camera.size
    border = [(x, y) for x in range(w) for y in (0, h - 1)] + [(x, y) for x in (0, w - 1) for y in range(h)]
    seen = camera.undistort(np.array(border)) @ full.matrix[:2, :2].T + full.matrix[:2, 2]
    np.testing.assert_allclose([seen.min(0), seen.max(0)], [[0, 0], [89, 69]], atol=1e-9)
    assert reaches(camera, full).all() == (camera.omega == 0)


def test_what_no_pinhole_camera_shows():
    with pytest.raises(BadInputError, match="corners are 90 degrees"):
        full_camera(wide(), (64, 48))
    fisheye = FovCamera(np.array([[30.0, 0, 64], [0, 30, 51], [0, 0, 1]]), 0.95, (128, 102))
    with pytest.raises(BadInputError, match="reaches 90 degrees"):
        crop_camera(fisheye, (64, 48))
    with pytest.raises(BadInputError, match=r"optical axis is at \(-.*outside the 128x102"):
        crop_camera(narrow(cx=-0.1), (64, 48))


def line_points(image: np.ndarray) -> np.ndarray:
    """The row of the dark line in each column, as the centroid of darkness."""
    dark = 255.0 - image
    return (dark * np.arange(len(image))[:, None]).sum(0) / dark.sum(0)


def test_straight_lines_become_straight():
    """A blurred straight line in space, seen through the lens, is bent; rectified, it is straight and in its place."""
    camera = narrow((640, 512))
    columns, rows = np.meshgrid(np.arange(640), np.arange(512))
    x, y = camera.undistort(np.column_stack([columns.ravel(), rows.ravel()])).T
    away = (y - 0.35 - 0.1 * x).reshape(512, 640)
    image = np.round(255 - 255 * np.exp(-((away / 0.02) ** 2))).astype(np.uint8)
    to = crop_camera(camera, (320, 240))
    across = np.arange(20, 300)
    found = line_points(Rectification(camera, to)(image))[across]
    expected = to.matrix[1, 1] * (0.35 + 0.1 * (across - to.matrix[0, 2]) / to.matrix[0, 0]) + to.matrix[1, 2]
    assert np.abs(found - expected).max() < 0.05
    seen = line_points(image)[40:600]
    assert np.abs(seen - np.polyval(np.polyfit(np.arange(560), seen, 1), np.arange(560))).max() > 3


def test_without_distortion_the_same_camera_changes_nothing():
    camera = narrow(omega=0.0)
    image = np.random.default_rng(0).integers(0, 256, (102, 128), np.uint8)
    np.testing.assert_array_equal(Rectification(camera, Camera(camera.matrix, (128, 102)))(image), image)
