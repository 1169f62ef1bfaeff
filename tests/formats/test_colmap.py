import sqlite3

import numpy as np
import pytest
from textured_scenes import flight, keypoints
from tiny_network import tiny_detector

from sips_lit.describe.sift import RootSift, SiftDescriptor
from sips_lit.errors import BadInputError
from sips_lit.formats.colmap import ColmapDatabase, ColmapText, sift_bytes
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Features, Keypoints, Matches

POINTS = keypoints([[0, 0], [30.25, 7.5]], None, 2.0)
ROWS = np.abs(np.random.default_rng(0).standard_normal((2, 128))).astype(np.float32)
ROWS /= np.linalg.norm(ROWS, axis=1, keepdims=True)
SCENE = flight(2, size=(320, 240))


@pytest.fixture(scope="module")
def pycolmap():
    return pytest.importorskip("pycolmap", reason="it reads and verifies what COLMAP is given: pip install pycolmap")


@pytest.fixture(scope="module")
def features() -> list[Features]:
    """Of both images of SCENE."""
    described = []
    for image in SCENE.frames:
        points = tiny_detector()(image, 300)
        described.append(Features(points, RootSift().describe(image, points), "l2"))
    return described


def add_both(database: ColmapDatabase, features: list[Features], described: bool) -> None:
    for name, one in zip(("a.png", "b.png"), features, strict=True):
        database.add(name, (320, 240), one.keypoints, one.descriptors if described else None)


def test_what_is_in_the_database(tmp_path):
    path = tmp_path / "new" / "database.db"
    with ColmapDatabase(path) as database:
        database.add("a.png", (64, 48), POINTS, ROWS)
        database.add("b.png", (48, 64), Keypoints.empty())
        database.add("c.png", (64, 48), POINTS)
        database.add_matches("c.png", "a.png", Matches(np.array([0, 1]), np.array([1, 0])))
        assert database.images == 3
        assert not path.exists()
    assert [entry.name for entry in path.parent.iterdir()] == ["database.db"]
    sql = sqlite3.connect(path)
    assert sql.execute("SELECT image_id, name, camera_id FROM images").fetchall() == [
        (1, "a.png", 1),
        (2, "b.png", 2),
        (3, "c.png", 1),
    ]
    model, width, height, params = sql.execute("SELECT model, width, height, params FROM cameras").fetchone()
    assert (model, width, height) == (2, 64, 48)
    np.testing.assert_allclose(np.frombuffer(params), [1.2 * 64, 32, 24, 0])
    rows, cols, data = sql.execute("SELECT rows, cols, data FROM keypoints WHERE image_id = 1").fetchone()
    np.testing.assert_array_equal(
        np.frombuffer(data, np.float32).reshape(rows, cols), [[0.5, 0.5, 2, 0], [30.75, 8, 2, 0]]
    )
    assert sql.execute("SELECT rows, cols FROM keypoints WHERE image_id = 2").fetchone() == (0, 4)
    assert sql.execute("SELECT image_id, rows, cols FROM descriptors").fetchall() == [(1, 2, 128)]
    pair, data = sql.execute("SELECT pair_id, data FROM matches").fetchone()
    assert pair == 1 * 2147483647 + 3
    np.testing.assert_array_equal(np.frombuffer(data, np.uint32).reshape(-1, 2), [[1, 0], [0, 1]])
    sql.close()


def test_pycolmap_reads_the_database(tmp_path, pycolmap):
    with ColmapDatabase(tmp_path / "database.db") as database:
        database.add("a.png", (64, 48), POINTS, ROWS)
    read = pycolmap.Database.open(tmp_path / "database.db")
    camera = read.read_camera(1)
    assert (camera.model.name, camera.width, camera.height) == ("SIMPLE_RADIAL", 64, 48)
    assert not camera.has_prior_focal_length
    assert read.read_image(1).name == "a.png"
    np.testing.assert_array_equal(np.asarray(read.read_keypoints(1))[:, :2], POINTS.xy + 0.5)
    np.testing.assert_array_equal(read.read_descriptors(1).data, sift_bytes(ROWS))
    read.close()


def inliers(pycolmap, path) -> np.ndarray:
    """The matches that COLMAP verified, and how far they are from the truth in pixels."""
    read = pycolmap.Database.open(path)
    pairs = read.read_two_view_geometry(1, 2).inlier_matches
    places = [np.asarray(read.read_keypoints(image))[pairs[:, image - 1], :2] - 0.5 for image in (1, 2)]
    read.close()
    moved = np.column_stack([places[0], np.ones(len(pairs))]) @ SCENE.homography(0, 1).T
    return np.linalg.norm(moved[:, :2] / moved[:, 2:] - places[1], axis=1)


def test_pycolmap_verifies_our_matches(tmp_path, pycolmap, features):
    path = tmp_path / "database.db"
    with ColmapDatabase(path) as database:
        add_both(database, features, described=False)
        database.add_matches("a.png", "b.png", mutual_nearest(distances(*features)))
    pycolmap.geometric_verification(path)
    error = inliers(pycolmap, path)
    assert len(error) > 30
    assert np.median(error) < 1


def test_pycolmap_matches_and_verifies_our_points(tmp_path, pycolmap, features):
    path = tmp_path / "database.db"
    with ColmapDatabase(path) as database:
        add_both(database, features, described=True)
    pycolmap.match_exhaustive(path, device=pycolmap.Device.cpu)
    error = inliers(pycolmap, path)
    assert len(error) > 30
    assert np.median(error) < 1


def test_names_and_matches_are_given_once_and_in_order(tmp_path):
    with ColmapDatabase(tmp_path / "database.db") as database:
        database.add("a.png", (64, 48), POINTS)
        with pytest.raises(BadInputError, match=r"has the image a\.png already"):
            database.add("a.png", (64, 48), POINTS)
        none = Matches(np.zeros(0, np.int64), np.zeros(0, np.int64))
        with pytest.raises(BadInputError, match=r"has no image b\.png"):
            database.add_matches("a.png", "b.png", none)
        database.add("b.png", (64, 48), POINTS)
        database.add_matches("a.png", "b.png", none)
        with pytest.raises(BadInputError, match=r"matches of b\.png and a\.png already"):
            database.add_matches("b.png", "a.png", none)


def test_text_for_the_feature_importer(tmp_path):
    text = ColmapText(tmp_path / "text")
    text.add("a.png", (64, 48), POINTS, ROWS)
    text.add("b.png", (64, 48), Keypoints.empty(), np.zeros((0, 128), np.float32))
    text.close()
    head, *lines = (tmp_path / "text" / "a.png.txt").read_text().splitlines()
    assert head == "2 128"
    table = np.array([line.split() for line in lines], np.float64)
    np.testing.assert_array_equal(table[:, :4], [[0.5, 0.5, 2, 0], [30.75, 8, 2, 0]])
    np.testing.assert_array_equal(table[:, 4:], sift_bytes(ROWS))
    assert (tmp_path / "text" / "b.png.txt").read_text() == "0 128\n"
    with pytest.raises(BadInputError, match="choose descriptor=rootsift or sift"):
        text.add("c.png", (64, 48), POINTS)


def test_descriptors_as_bytes():
    image, points = SCENE.frames[0], keypoints([[100, 100], [150, 80]])
    plain = SiftDescriptor().describe(image, points)
    np.testing.assert_array_equal(sift_bytes(plain), plain)
    rooted = sift_bytes(RootSift().describe(image, points))
    np.testing.assert_allclose(np.linalg.norm(rooted.astype(float), axis=1), 512, rtol=0.01)
    assert sift_bytes(np.zeros((0, 128), np.float32)).shape == (0, 128)
    for other in (-ROWS, ROWS[:, :64], np.zeros((2, 128), np.uint8)):
        with pytest.raises(BadInputError, match="COLMAP matches SIFT descriptors of 128 values"):
            sift_bytes(other)
