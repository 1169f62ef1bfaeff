from pathlib import PurePosixPath

import numpy as np
import pytest

from sips_lit.baselines.feature_files import open_features
from sips_lit.errors import BadInputError

IMAGE = PurePosixPath("a/1.png")
XY = np.array([[5.25, 6.5], [20, 3], [11, 12.75]], np.float64)
SCORES = np.array([0.2, 0.9, 0.4], np.float16)
DESCRIPTORS = np.arange(12).reshape(3, 4)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a").mkdir()
    return tmp_path


@pytest.mark.parametrize("name", ["a/1.npz", "a/1.png.npz"])
def test_a_file_of_either_name_in_our_types(name, folder):
    np.savez(folder / name, keypoints=XY, scores=SCORES, descriptors=DESCRIPTORS, image_size=[40, 30])
    files = open_features(folder)
    assert files.has(IMAGE)
    saved = files.read(IMAGE)
    np.testing.assert_array_equal(saved.xy, XY)
    assert saved.xy.dtype == saved.score.dtype == saved.descriptors.dtype == np.float32
    assert (saved.scale, saved.size) == (None, (40, 30))


def test_no_file_for_the_image(folder):
    files = open_features(folder)
    assert not files.has(IMAGE)
    with pytest.raises(BadInputError, match=r"no features of a/1\.png: add a/1\.npz"):
        files.read(IMAGE)


def test_h5_without_local_features(folder):
    h5py = pytest.importorskip("h5py", reason="h5py is missing: pip install 'sips_lit[baselines]'")
    with h5py.File(folder / "global.h5", "w") as file:
        file.create_group("a/1.png")["global_descriptor"] = np.ones(8)
    with pytest.raises(BadInputError, match=r"global\.h5 holds no keypoints"):
        open_features(folder / "global.h5")


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({}, "has no keypoints, only nothing"),
        ({"points": XY}, "has no keypoints, only points"),
        ({"keypoints": XY.T}, "do not belong together"),
        ({"keypoints": XY[:, 0]}, "do not belong together"),
        ({"keypoints": XY, "scores": SCORES[:2]}, r"scores \(2,\)"),
        ({"keypoints": XY, "descriptors": DESCRIPTORS.T}, r"descriptors \(4, 3\)"),
        ({"keypoints": XY, "scales": np.float32(3)}, r"scales \(\)"),
    ],
)
def test_files_that_can_not_be_used(held, message, folder):
    np.savez(folder / "a" / "1.npz", **held)
    with pytest.raises(BadInputError, match=message):
        open_features(folder).read(IMAGE)
