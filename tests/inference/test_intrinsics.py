import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.inference.intrinsics import both_cameras, read_intrinsics
from sips_lit.types import Camera

K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
SHAPE = (480, 640)


def test_one_camera_or_two():
    for given in (K, K.tolist(), Camera(K, (640, 480))):
        first, second = both_cameras(given, SHAPE, SHAPE)
        np.testing.assert_array_equal(first.matrix, K)
        assert first.size == second.size == (640, 480)
    other = K * [[2], [2], [1]]
    first, second = both_cameras([K, other], SHAPE, (960, 1280))
    np.testing.assert_array_equal(second.matrix, other)
    assert second.size == (1280, 960)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (np.eye(4), r"camera must be a Camera or a matrix \(3, 3\), not of shape \(4, 4\)"),
        ([500, 500, 320, 240], r"not of shape \(4,\)"),
        ([K, np.eye(2)], r"camera 1 must be .* not of shape \(2, 2\)"),
        (K.T, "its rows are"),
        ([["a", 0, 0]] * 3, "no matrix"),
        (K * [[0.001], [0.001], [1]], "can't be of images of 640x480"),
        (K * np.nan, "its rows are"),
        (Camera(K, (320, 240)), "is of images of 320x240, but this one is 640x480"),
    ],
)
def test_what_is_no_camera_of_the_image(given, reason):
    with pytest.raises(BadInputError, match=reason):
        both_cameras(given, SHAPE, SHAPE)


def test_numbers_and_files(tmp_path):
    file = tmp_path / "camera.txt"
    for text in ("500 510 320 240\n", "# fx fy cx cy\n500 510 320 240", "500 0 320\n0 510 240\n0 0 1\n"):
        file.write_text(text)
        np.testing.assert_array_equal(read_intrinsics(str(file)), K)
    np.testing.assert_array_equal(read_intrinsics([500, 510, 320, 240]), K)
    np.testing.assert_array_equal(read_intrinsics(["500", "510", "320", "240"]), K)


@pytest.mark.parametrize(("given", "reason"), [([1, 2, 3], "give"), (7, "give"), (["a", 1, 2, 3], "give")])
def test_what_are_no_intrinsics(given, reason):
    with pytest.raises(BadInputError, match=reason):
        read_intrinsics(given)


@pytest.mark.parametrize(
    ("text", "reason"),
    [("1 2", "has 2 values"), ("1 2 3\n1 2 3", "2 rows of 3"), ("a b c d", "where a number"), ("", "no numbers")],
)
def test_files_of_something_else(tmp_path, text, reason):
    (tmp_path / "camera.txt").write_text(text)
    with pytest.raises(BadInputError, match=reason):
        read_intrinsics(tmp_path / "camera.txt")
    with pytest.raises(BadInputError, match="cannot read"):
        read_intrinsics(tmp_path / "none.txt")
