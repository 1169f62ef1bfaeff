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
        ({"keypoints": XY.astype(str)}, "do not belong together"),
        ({"keypoints": XY, "image_size": np.float64(3)}, r"image_size \(\)"),
        ({"keypoints": XY, "image_size": [np.nan, 30]}, "has image_size that are not finite"),
        ({"keypoints": XY * [1, np.nan]}, "has keypoints that are not finite: it is damaged"),
        ({"keypoints": XY * 1e300}, "has keypoints that are not finite"),
        ({"keypoints": XY, "scores": [1, np.inf, 2]}, "has scores that are not finite"),
        ({"keypoints": XY, "scales": [1, np.nan, 2]}, "has scales that are not finite"),
        ({"keypoints": np.array([{}, {}])}, "is not a plain array of numbers"),
    ],
)
def test_files_that_can_not_be_used(held, message, folder):
    np.savez(folder / "a" / "1.npz", **held)
    with pytest.raises(BadInputError, match=message):
        open_features(folder).read(IMAGE)


def test_h5_is_checked_alike(folder):
    h5py = pytest.importorskip("h5py", reason="h5py is missing: pip install 'sips_lit[baselines]'")
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_group("a/1.png")["keypoints"] = XY * [1, np.nan]
        file.create_group("a/2.png")["keypoints"] = XY
        file["a/2.png"]["scores"] = ["some", "more", "words"]
    with pytest.raises(BadInputError, match=r"a/1\.png in .*a\.h5 has keypoints that are not finite"):
        open_features(folder / "a.h5").read(IMAGE)
    with pytest.raises(BadInputError, match=r"a\.h5 can't be read as h5: it is damaged"):
        open_features(folder / "a.h5").read(PurePosixPath("a/2.png"))


def test_descriptors_that_are_not_finite_are_left_to_be_counted(folder):
    np.savez(folder / "a" / "1.npz", keypoints=XY, descriptors=DESCRIPTORS * np.nan)
    assert np.isnan(open_features(folder).read(IMAGE).descriptors).all()
