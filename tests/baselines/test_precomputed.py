import pickle

import cv2
import numpy as np
import pytest

from sips_lit.baselines.precomputed import PrecomputedDetector
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.inference.streams import Frame
from sips_lit.inference.writers import NpzWriter
from sips_lit.types import Keypoints

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
