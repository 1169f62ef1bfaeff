import json
import math
import warnings

import cv2
import numpy as np
import pytest
from rgbd_files import SIMPLE_K, depth_of, pose, render, write_image, write_simple

from sips_lit.datasets.rgbd import rgbd
from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import transfer
from sips_lit.pairs.sampler import read_pair


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    return write_simple(tmp_path_factory.mktemp("rgbd") / "desk")


def photometric_error(sequence, i: int, j: int, T: np.ndarray | None = None) -> float:
    """Median difference in grey values of pixels of frame i and where they are in frame j by ``T`` (default: the truth)."""
    pair = read_pair(sequence, i, j, between=False)
    T = pair.geometry.T_1_0 if T is None else T
    height, width = pair.image0.shape
    xy = np.stack(np.meshgrid(np.arange(0, width, 2), np.arange(0, height, 2)), -1)
    depth = pair.geometry.depth0[xy[..., 1], xy[..., 0]]
    moved, _ = transfer(xy.reshape(-1, 2), depth.ravel().astype(float), pair.geometry.camera0, pair.geometry.camera1, T)
    with np.errstate(invalid="ignore"):
        inside = ((moved >= 1) & (moved <= [width - 2, height - 2])).all(1)
    assert inside.sum() > 400
    at = np.nan_to_num(moved, nan=-1).reshape(*xy.shape).astype(np.float32)
    seen = cv2.remap(pair.image1, at[..., 0], at[..., 1], cv2.INTER_LINEAR).ravel()[inside].astype(float)
    return float(np.median(np.abs(seen - pair.image0[xy[..., 1], xy[..., 0]].ravel()[inside])))


def test_a_sequence_as_stored(desk):
    (sequence,) = rgbd(desk)
    assert (sequence.name, len(sequence), sequence.frame_name(2)) == ("desk", 4, "desk_color_image_0002")
    image, depth = render(2, SIMPLE_K, (160, 120))
    np.testing.assert_array_equal(sequence.frame(2), image)
    np.testing.assert_array_equal(sequence.camera(2).matrix, SIMPLE_K)
    np.testing.assert_allclose(sequence.pose(2), pose(2), atol=1e-9)
    known = np.isfinite(sequence.depth(2))
    assert sequence.depth(2).dtype == np.float32
    assert (~known).sum() == 20
    assert not known[10:14, 20:25].any()
    np.testing.assert_allclose(sequence.depth(2)[known], depth[known], atol=6e-4)
    assert sequence.time(0) is None


@pytest.mark.parametrize("max_side", [None, 96, 61])
def test_pose_and_depth_lead_to_the_same_place(desk, max_side):
    (sequence,) = rgbd(desk, max_side=max_side)
    truth = np.linalg.inv(pose(3)) @ pose(0)
    right = photometric_error(sequence, 0, 3)
    assert right < 0.5 * photometric_error(sequence, 0, 3, np.eye(4))
    assert right < 0.5 * photometric_error(sequence, 0, 3, np.linalg.inv(truth))


@pytest.mark.parametrize("max_side", [96, 80, 41])
def test_shrunk_cameras_and_depth_fit_each_other(desk, max_side):
    (sequence,) = rgbd(desk, max_side=max_side)
    height, width = sequence.frame(1).shape
    assert max(height, width) == max_side
    assert sequence.camera(1).size == (width, height)
    depth = sequence.depth(1)
    assert depth.shape == (height, width)
    xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
    expected = depth_of(xy, pose(1), sequence.camera(1).matrix)[0]
    known = np.isfinite(depth.ravel())
    # the nearest stored pixel is up to half a pixel of the original off
    np.testing.assert_allclose(depth.ravel()[known], expected[known], atol=4e-3)
    assert (
        abs(np.mean(depth.ravel()[known] - expected[known])) < 1e-3
    )  # half a pixel is 1e-3 where two are equally near


def test_a_folder_of_sequences(desk, tmp_path):
    for name in ("a", "b"):
        write_simple(tmp_path / "all" / name, 2)
    (tmp_path / "all" / "notes").mkdir()
    sequences = rgbd(tmp_path / "all")
    assert [s.name for s in sequences] == ["all_a", "all_b"]
    assert len({s.fingerprint for s in [*sequences, *rgbd(desk), *rgbd(desk, max_side=64)]}) == 4
    assert rgbd(desk)[0].fingerprint == rgbd(desk)[0].fingerprint


@pytest.mark.parametrize("missing", ["depth", "poses.txt", "cam.json"])
def test_missing_parts(tmp_path, missing):
    write_simple(tmp_path, 2)
    (tmp_path / missing).rename(tmp_path / "elsewhere")
    with pytest.raises(BadInputError, match=rf"there is no .*{missing}.* has .*elsewhere.*poses\.txt"):
        rgbd(tmp_path)


@pytest.mark.parametrize("make", ["nothing", "empty", "file"])
def test_not_an_rgbd_sequence(tmp_path, make):
    root = tmp_path / "root"
    if make == "empty":
        root.mkdir()
    if make == "file":
        root.write_text("")
    with pytest.raises(BadInputError, match=r"there is no RGB-D sequence at .*root"):
        rgbd(root)


def test_half_downloaded(tmp_path):
    write_simple(tmp_path, 3)
    (tmp_path / "depth" / "depth_image_0001.png").unlink()
    with pytest.raises(BadInputError, match=r"3 images .* 2 depth maps .* 3 rows"):
        rgbd(tmp_path)
    (tmp_path / "depth" / "depth_image_0002.png").rename(tmp_path / "depth" / "depth_image_0009.png")
    write_image(tmp_path / "depth" / "depth_image_0001.png", np.zeros((120, 160), np.uint16))
    with pytest.raises(BadInputError, match=r"color_image_0002.*depth_image_0009.*different numbers"):
        rgbd(tmp_path)


def test_depth_of_another_kind_or_size(tmp_path):
    write_simple(tmp_path, 3)
    write_image(tmp_path / "depth" / "depth_image_0000.png", np.ones((60, 80), np.uint16))
    cv2.imwrite(str(tmp_path / "depth" / "depth_image_0001.png"), np.ones((120, 160), np.uint8))
    (tmp_path / "depth" / "depth_image_0002.png").write_bytes(b"nothing")
    (sequence,) = rgbd(tmp_path)
    for index, message in enumerate((r"is 80x60, but its image is 160x120", "type uint8", "damaged")):
        with pytest.raises(BadInputError, match=rf"depth_image_000{index}.*{message}"):
            sequence.depth(index)


def test_a_camera_that_is_not_of_the_images(tmp_path):
    write_simple(tmp_path, 2)
    file = tmp_path / "cam.json"
    camera = json.loads(file.read_text())
    file.write_text(json.dumps(camera | {"w": 320, "h": 240}))
    with pytest.raises(BadInputError, match="is 160x120, but its camera is for 320x240"):
        rgbd(tmp_path)[0].frame(0)
    infinite = [{key: value} for key in ("px", "u0", "w", "depthScale") for value in (math.inf, math.nan, -math.inf)]
    for wrong in ({"px": -1.0}, {"model": "KannalaBrandt"}, {"w": "wide"}, {"depthScale": None}, *infinite):
        file.write_text(json.dumps(camera | wrong))
        with pytest.raises(BadInputError, match=r"cam\.json"):
            rgbd(tmp_path)
    for text in ("{", "[" * 100_000, "[1]", '{"px": ' + "9" * 5000 + "}"):
        file.write_text(text)
        with pytest.raises(BadInputError, match=r"cam\.json (is not readable as|holds no object of) JSON"):
            rgbd(tmp_path)


@pytest.mark.parametrize("options", [{"max_side": 8}, {"tolerance": -1.0}, {"tolerance": float("nan")}])
def test_options_that_make_no_sense(desk, options):
    with pytest.raises(BadInputError, match=next(iter(options))):
        rgbd(desk, **options)


def test_nothing_to_warn_of(desk):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rgbd(desk, drop_incomplete=True)


@pytest.mark.shared_data
@pytest.mark.parametrize("max_side", [None, 320])
def test_real_poses_and_depth(shared_data, max_side):
    (sequence,) = rgbd(shared_data / "rgbd_desk", max_side=max_side)
    assert len(sequence) == 99
    for i, j in [(0, 60), (20, 40), (50, 40)]:
        right = photometric_error(sequence, i, j)
        backwards = sequence.pose(j) @ np.linalg.inv(sequence.pose(i))
        assert right < 0.8 * photometric_error(sequence, i, j, np.eye(4))
        assert right < 0.8 * photometric_error(sequence, i, j, backwards)
