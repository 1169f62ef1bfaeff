import pickle
import shutil
from pathlib import PurePosixPath

import cv2
import numpy as np
import pytest

from sips_lit.baselines.precomputed import PrecomputedDetector, open_features
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.inference.streams import Frame
from sips_lit.inference.writers import NpzWriter
from sips_lit.types import Keypoints

IMAGE = PurePosixPath("a/1.png")
XY = np.array([[5.25, 6.5], [20, 3], [11, 12.75]], np.float32)
SCORES = np.array([0.2, 0.9, 0.4], np.float32)
ORDER = [1, 2, 0]
DESCRIPTORS = np.arange(12, dtype=np.float32).reshape(3, 4)


@pytest.fixture
def images(tmp_path):
    """Three colour images in folders, of 40 x 30 pixels."""
    for index, name in enumerate(["a/1.png", "a/2.png", "b/1.png"]):
        path = tmp_path / "images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.random.default_rng(index).integers(0, 255, (30, 40, 3)).astype(np.uint8))
    return tmp_path / "images"


@pytest.fixture
def features(tmp_path):
    folder = tmp_path / "features"
    (folder / "a").mkdir(parents=True)
    (folder / "b").mkdir()
    return folder


def test_npz_found_by_what_the_image_shows(images, features):
    names = ["a/1.npz", "a/2.png.npz", "b/1.npz"]
    for index, name in enumerate(names):
        np.savez(features / name, keypoints=XY + index, scores=SCORES, scales=SCORES + 1, descriptors=DESCRIPTORS)
    detector = PrecomputedDetector(features, images, "LIFT")
    assert (detector.name, detector.scores, detector.describes) == ("LIFT", "order", True)
    for index, name in enumerate(["a/1.png", "a/2.png", "b/1.png"]):
        found = detector.detect_and_describe(read_grey(images / name), 5)
        np.testing.assert_array_equal(found.keypoints.xy, XY[ORDER] + index)
        np.testing.assert_array_equal(found.keypoints.score, SCORES[ORDER])
        np.testing.assert_array_equal(found.keypoints.scale, SCORES[ORDER] + 1)
        np.testing.assert_array_equal(found.descriptors, DESCRIPTORS[ORDER])
        assert found.norm == "l2"
    assert len(detector.detect(read_grey(images / "a/1.png"), 2)) == 2
    again = pickle.loads(pickle.dumps(detector)).detect(read_grey(images / "b/1.png"), 1)
    np.testing.assert_array_equal(again.xy, XY[1:2] + 2)


def test_what_sips_detect_writes(images, tmp_path):
    grey = read_grey(images / "a" / "1.png")
    points = Keypoints(XY[ORDER], SCORES[ORDER], np.ones(3, np.float32))
    writer = NpzWriter(tmp_path / "points")
    writer.write(Frame(name="1", grey=grey, picture=grey), points)
    detector = PrecomputedDetector(tmp_path / "points", images / "a")
    assert not detector.describes
    np.testing.assert_array_equal(detector.detect(grey, 9).xy, points.xy)
    with pytest.raises(TypeError, match="no descriptors"):
        detector.detect_and_describe(grey, 9)


def test_lf_net_has_no_scores(images, features):
    np.savez(features / "a" / "1.png.npz", kpts=XY, descs=DESCRIPTORS)
    detector = PrecomputedDetector(features, images)
    found = detector.detect_and_describe(read_grey(images / "a/1.png"), 9)
    assert detector.scores == "none"
    np.testing.assert_array_equal(found.keypoints.xy, XY)  # in their own order
    assert (np.diff(found.keypoints.score) < 0).all()
    np.testing.assert_array_equal(found.descriptors, DESCRIPTORS)


def test_hloc(images, tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is missing: pip install 'sips_lit[baselines]'")
    with h5py.File(tmp_path / "feats.h5", "w") as file:
        for index, name in enumerate(["a/1.png", "b/1.png", "gone/1.png"]):
            group = file.create_group(name)
            group["keypoints"], group["scores"] = (XY + index).astype(np.float16), SCORES.astype(np.float16)
            group["descriptors"] = DESCRIPTORS.T.astype(np.float16)
            group["image_size"] = np.array([40, 30])
    detector = PrecomputedDetector(tmp_path / "feats.h5", images)
    found = detector.detect_and_describe(read_grey(images / "b/1.png"), 9)
    np.testing.assert_array_equal(found.keypoints.xy, XY[ORDER] + 1)
    np.testing.assert_array_equal(found.descriptors, DESCRIPTORS[ORDER])
    assert found.descriptors.dtype == found.keypoints.score.dtype == np.float32
    with pytest.raises(BadInputError, match=r"none of the 2 below"):
        detector.detect(read_grey(images / "a/2.png"), 9)


def test_binary_descriptors_are_compared_by_hamming(images, features):
    np.savez(features / "a" / "1.npz", keypoints=XY, scores=SCORES, descriptors=DESCRIPTORS.astype(np.uint8))
    found = PrecomputedDetector(features, images).detect_and_describe(read_grey(images / "a/1.png"), 9)
    assert (found.norm, found.descriptors.dtype) == ("hamming", np.uint8)


def test_no_points_are_legal(images, features):
    np.savez(features / "a" / "1.npz", keypoints=np.zeros((0, 2)), scores=np.zeros(0), descriptors=np.zeros((0, 4)))
    found = PrecomputedDetector(features, images).detect_and_describe(read_grey(images / "a/1.png"), 9)
    assert found.descriptors.shape == (0, 4)


def test_images_that_were_changed_are_refused(images, features):
    np.savez(features / "a" / "1.npz", keypoints=XY, scores=SCORES, image_size=[40, 31])
    detector = PrecomputedDetector(features, images)
    grey = read_grey(images / "a/1.png")
    with pytest.raises(BadInputError, match=r"20 x 15 pixels is none of the 1 below .*max_side"):
        detector.detect(cv2.resize(grey, (20, 15)), 3)
    with pytest.raises(BadInputError, match=r"of an image of size \(40, 31\), not \(40, 30\)"):
        detector.detect(grey, 3)


def test_same_bytes_of_another_shape_are_another_image(images, features):
    np.savez(features / "a" / "1.npz", keypoints=XY, scores=SCORES)
    with pytest.raises(BadInputError, match="30 x 40 pixels"):
        PrecomputedDetector(features, images).detect(read_grey(images / "a/1.png").reshape(40, 30), 3)


def test_wrong_folders(images, features, tmp_path):
    with pytest.raises(BadInputError, match=r"there are no features .*nothing"):
        PrecomputedDetector(tmp_path / "nothing", images)
    with pytest.raises(BadInputError, match=r"there is no folder .*nothing"):
        PrecomputedDetector(features, tmp_path / "nothing")
    with pytest.raises(BadInputError, match=r"none of the 3 images below .*such as a/1\.png"):
        PrecomputedDetector(features, images)
    (tmp_path / "damaged.h5").write_bytes(b"nonsense")
    with pytest.raises(BadInputError, match=r"damaged\.h5 can't be read as h5"):
        PrecomputedDetector(tmp_path / "damaged.h5", images)


def test_damaged_and_inconsistent_files(images, features):
    np.savez(features / "a" / "1.npz", keypoints=XY, scores=SCORES)
    np.savez(features / "a" / "2.npz", keypoints=XY)
    (features / "b" / "1.npz").write_bytes(b"PK\x03\x04 nonsense")
    detector = PrecomputedDetector(features, images)
    with pytest.raises(BadInputError, match="other parts than those of the first"):
        detector.detect(read_grey(images / "a/2.png"), 3)
    with pytest.raises(BadInputError, match=r"b/1\.npz is not an npz archive"):
        detector.detect(read_grey(images / "b/1.png"), 3)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a").mkdir()
    return tmp_path


@pytest.mark.parametrize("name", ["a/1.npz", "a/1.png.npz"])
def test_a_file_of_either_name_in_our_types(name, folder):
    half, whole = SCORES.astype(np.float16), DESCRIPTORS.astype(int)
    np.savez(folder / name, keypoints=XY.astype(np.float64), scores=half, descriptors=whole, image_size=[40, 30])
    files = open_features(folder)
    assert files.has(IMAGE)
    saved = files.read(IMAGE)
    np.testing.assert_array_equal(saved.keypoints, XY)
    assert saved.keypoints.dtype == saved.scores.dtype == saved.descriptors.dtype == np.float32
    assert (saved.scales, saved.image_size) == (None, (40, 30))


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


def test_what_else_is_in_a_file_does_not_matter(folder):
    np.savez(folder / "a" / "1.npz", keypoints=XY, settings=np.array({"n": 5}, object))
    np.testing.assert_array_equal(open_features(folder).read(IMAGE).keypoints, XY)


def test_hidden_folders_hold_no_images(images, features):
    for name in ("a/1", "b/1"):
        np.savez(features / f"{name}.npz", keypoints=XY, scores=SCORES)
    found = PrecomputedDetector(features, images).image_of
    assert len(found) == 2
    for hidden in (".ipynb_checkpoints", "__MACOSX", "a/@eaDir"):
        shutil.copytree(images / "a", images / hidden / "a")
        shutil.copytree(features / "a", features / hidden / "a")
    assert PrecomputedDetector(features, images).image_of == found


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
