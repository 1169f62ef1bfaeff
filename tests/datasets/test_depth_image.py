import cv2
import numpy as np
import pytest

from sips_lit.datasets.depth_image import read_depth_image, to_metres
from sips_lit.errors import BadInputError


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
