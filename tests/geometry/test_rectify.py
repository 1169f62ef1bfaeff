import cv2
import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.geometry.rectify import LensCamera, Rectifier, rectify_mono, rectify_stereo

SIZE = (188, 120)
LEFT = LensCamera(np.array([[115.0, 0, 91.5], [0, 114.0, 62.0], [0, 0, 1]]), np.array([-0.28, 0.07, 2e-4, 2e-5]), SIZE)
RIGHT = LensCamera(
    np.array([[114.0, 0, 95.0], [0, 113.5, 63.5], [0, 0, 1]]), np.array([-0.27, 0.075, -1e-4, -4e-5, 0.002]), SIZE
)


def to_right(baseline: float = 0.11) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.014, -0.003, 0.02]))[0]
    T[:3, 3] = T[:3, :3] @ [-baseline, 0.002, -0.001]
    return T


def stored_pixels(lens: LensCamera, points: np.ndarray) -> np.ndarray:
    """OpenCV's model of the lens: pixels (N, 2) of points (N, 3)."""
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)[0][:, 0]


def rectified_pixels(rectifier: Rectifier, points: np.ndarray) -> np.ndarray:
    projected = points @ rectifier.rotation.T @ rectifier.camera.matrix.T
    return projected[:, :2] / projected[:, 2:]


def assert_maps_agree(rectifier: Rectifier, lens: LensCamera, points: np.ndarray) -> None:
    """Where the map says that a rectified pixel comes from is where the lens puts the point."""
    pixels = rectified_pixels(rectifier, points)
    inside = np.all((pixels >= 1) & (pixels <= np.array(SIZE) - 2), axis=1)
    assert inside.sum() > 50
    where = pixels[inside].astype(np.float32)[:, None]
    found = [cv2.remap(m, where, None, cv2.INTER_LINEAR)[:, 0] for m in (rectifier.x, rectifier.y)]
    np.testing.assert_allclose(np.column_stack(found), stored_pixels(lens, points[inside]), atol=0.05)


def scene(seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return generator.uniform((-3, -2, 3), (3, 2, 9), (300, 3))


def test_maps_lead_to_where_the_lens_puts_the_points():
    left, right, _ = rectify_stereo(LEFT, RIGHT, to_right())
    points = scene()
    assert_maps_agree(left, LEFT, points)
    T = to_right()
    assert_maps_agree(right, RIGHT, points @ T[:3, :3].T + T[:3, 3])
    assert_maps_agree(rectify_mono(RIGHT), RIGHT, points)


def test_rows_are_equal_and_disparity_tells_depth():
    T = to_right()
    left, right, baseline = rectify_stereo(LEFT, RIGHT, T)
    assert baseline == pytest.approx(np.linalg.norm(T[:3, 3]))
    np.testing.assert_allclose(left.camera.matrix, right.camera.matrix)
    assert left.camera.matrix[0, 0] == left.camera.matrix[1, 1]
    points = scene(1)
    in_left, in_right = rectified_pixels(left, points), rectified_pixels(right, points @ T[:3, :3].T + T[:3, 3])
    depth = (points @ left.rotation.T)[:, 2]
    np.testing.assert_allclose(in_left[:, 1], in_right[:, 1], atol=1e-8)
    disparity = left.camera.matrix[0, 0] * baseline / depth
    np.testing.assert_allclose(in_left[:, 0] - in_right[:, 0], disparity, atol=1e-8)


def test_no_pixel_is_from_outside():
    white = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    for rectifier in (*rectify_stereo(LEFT, RIGHT, to_right())[:2], rectify_mono(LEFT)):
        assert rectifier.camera.size == SIZE
        assert rectifier(white).shape == white.shape
        assert (rectifier(white) == 255).all()
        assert min(rectifier.x.min(), rectifier.y.min()) > -1
        assert rectifier.x.max() < SIZE[0]
        assert rectifier.y.max() < SIZE[1]


def test_undistorted_pixels_are_square():
    matrix = rectify_mono(LEFT).camera.matrix
    assert matrix[0, 0] == matrix[1, 1] > 0
    np.testing.assert_array_equal(rectify_mono(LEFT).rotation, np.eye(3))


def test_sides():
    with pytest.raises(BadInputError, match="not to the right of the first"):
        rectify_stereo(LEFT, RIGHT, to_right(-0.11))
    above = np.eye(4)
    above[1, 3] = -0.1
    with pytest.raises(BadInputError, match="not to the right of the first"):
        rectify_stereo(LEFT, RIGHT, above)


def equidistant_pixels(lens: LensCamera, points: np.ndarray) -> np.ndarray:
    """Kannala and Brandt's model, by its formula: pixels (N, 2) of points (N, 3)."""
    side = np.linalg.norm(points[:, :2], axis=1)
    angle = np.arctan2(side, points[:, 2])
    bent = angle * (1 + sum(k * angle ** (2 * i) for i, k in enumerate(lens.distortion, start=1)))
    plane = np.where(side > 0, bent / np.maximum(side, 1e-12), 1)[:, None] * points[:, :2]
    return plane * lens.matrix[[0, 1], [0, 1]] + lens.matrix[:2, 2]


# of TUM-VI's room sequences, rounded
WIDE = [
    LensCamera(
        np.array([[190.978, 0, 254.932], [0, 190.973, 256.897], [0, 0, 1]]),
        np.array([0.00348, 0.00072, -0.00205, 0.0002]),
        (512, 512),
        equidistant=True,
    ),
    LensCamera(
        np.array([[190.442, 0, 252.598], [0, 190.434, 254.917], [0, 0, 1]]),
        np.array([0.0034, 0.00177, -0.00266, 0.0003]),
        (512, 512),
        equidistant=True,
    ),
]


def test_equidistant_lenses():
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([-0.04, 0.002, 0.01]))[0]
    T[:3, 3] = T[:3, :3] @ [-0.101, 0.0016, -0.001]
    left, right, baseline = rectify_stereo(*WIDE, T)
    assert baseline == pytest.approx(0.101, abs=1e-4)
    points = np.random.default_rng(0).uniform([-2, -2, 1.5], [2, 2, 4], (500, 3))
    in_right = points @ T[:3, :3].T + T[:3, 3]
    mono = rectify_mono(WIDE[0])
    for rectifier, lens, own in ((mono, WIDE[0], points), (left, WIDE[0], points), (right, WIDE[1], in_right)):
        pixels = rectified_pixels(rectifier, own)
        inside = np.all((pixels >= 1) & (pixels <= 510), axis=1)
        assert inside.sum() > 200
        where = pixels[inside].astype(np.float32)[:, None]
        found = [cv2.remap(m, where, None, cv2.INTER_LINEAR)[:, 0] for m in (rectifier.x, rectifier.y)]
        np.testing.assert_allclose(np.column_stack(found), equidistant_pixels(lens, own[inside]), atol=0.02)
        assert rectifier.camera.matrix[0, 0] == rectifier.camera.matrix[1, 1] == pytest.approx(190.7, abs=0.5)
        assert rectifier.x.min() >= 0
        assert rectifier.x.max() <= 511
    x0, x1 = rectified_pixels(left, points), rectified_pixels(right, in_right)
    depth = (points @ left.rotation.T)[:, 2]
    np.testing.assert_allclose(x1[:, 1], x0[:, 1], atol=1e-6)  # rows are aligned
    np.testing.assert_allclose(x0[:, 0] - x1[:, 0], left.camera.matrix[0, 0] * baseline / depth, atol=1e-6)


@pytest.mark.parametrize("distortion", [(1e300, 0, 0, 0), (1e9, 1e9, 0, 0)])
def test_a_lens_that_shows_nothing_is_refused(distortion):
    lens = LensCamera(LEFT.matrix, np.array(distortion), LEFT.size)
    with pytest.raises(BadInputError, match=r"no pinhole camera shows .* set data\.rectify=false"):
        rectify_mono(lens)
