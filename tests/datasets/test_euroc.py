import logging
import pickle
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from euroc_files import LENSES, START, STEP, T_BODY_CAMERA, as_tum_vi, body_pose, make_euroc
from textured_scenes import texture

from sips_lit.datasets.euroc import euroc
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.geometry.rectify import rectify_mono, rectify_stereo


@pytest.mark.parametrize("where", ["V1_01_easy", "V1_01_easy/mav0"])
def test_a_sequence(tmp_path: Path, where: str):
    make_euroc(tmp_path / "V1_01_easy")
    (sequence,) = euroc(tmp_path / where)
    assert (sequence.name, len(sequence)) == ("V1_01_easy", 4)
    assert sequence.frame_name(1) == f"V1_01_easy_{START + STEP}"
    assert sequence.time(2) - sequence.time(0) == pytest.approx(0.1, abs=1e-6)
    left, right, baseline = rectify_stereo(*LENSES, np.linalg.inv(T_BODY_CAMERA[1]) @ T_BODY_CAMERA[0])
    np.testing.assert_array_equal(sequence.frame(1), left(texture(60, 94, 1)))
    np.testing.assert_array_equal(sequence.right(3), right(texture(60, 94, 13)))
    assert sequence.baseline() == pytest.approx(baseline) == pytest.approx(0.11, abs=1e-3)


def test_several_sequences(tmp_path: Path):
    for place in ("V1_01_easy", "MH_01_easy", "__MACOSX"):
        make_euroc(tmp_path / "a" / place)
    make_euroc(tmp_path / "b" / "V1_01_easy")
    assert [s.name for s in euroc(tmp_path / "a")] == ["MH_01_easy", "V1_01_easy"]
    assert [s.name for s in euroc(tmp_path)] == ["a_MH_01_easy", "a_V1_01_easy", "b_V1_01_easy"]


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("max_side", [None, 47])
def test_a_point_of_the_world_is_where_the_lens_sees_it(tmp_path: Path, cameras: int, max_side: int | None):
    mav0 = make_euroc(tmp_path, cameras)
    (sequence,) = euroc(mav0, max_side=max_side)
    rectifier = rectify_mono(LENSES[0])
    if cameras == 2:
        rectifier, *_ = rectify_stereo(*LENSES, np.linalg.inv(T_BODY_CAMERA[1]) @ T_BODY_CAMERA[0])
    T_camera_world = np.linalg.inv(body_pose(2 * STEP * 1e-9) @ T_BODY_CAMERA[0])
    world = np.linalg.inv(T_camera_world) @ [0.3, -0.2, 2.0, 1]
    stored, _ = cv2.projectPoints(
        world[None, :3], cv2.Rodrigues(T_camera_world[:3, :3])[0], T_camera_world[:3, 3],
        LENSES[0].matrix, LENSES[0].distortion,
    )  # fmt: skip
    seen = cv2.undistortPoints(
        stored, LENSES[0].matrix, LENSES[0].distortion, R=rectifier.rotation, P=rectifier.camera.matrix
    )[0, 0]
    height, width = sequence.frame(2).shape
    assert sequence.camera(2).size == (width, height) == ((94, 60) if max_side is None else (47, 30))
    x, y, depth = sequence.camera(2).matrix @ (np.linalg.inv(sequence.pose(2)) @ world)[:3]
    scale = width / 94
    np.testing.assert_allclose((x / depth, y / depth), (seen + 0.5) * scale - 0.5, atol=1e-3)


def test_without_a_second_camera(tmp_path: Path):
    (sequence,) = euroc(make_euroc(tmp_path, cameras=1))
    assert (sequence.right(0), sequence.baseline()) == (None, None)
    np.testing.assert_array_equal(sequence.frame(0), rectify_mono(LENSES[0])(texture(60, 94, 0)))


def test_as_stored(tmp_path: Path):
    (sequence,) = euroc(make_euroc(tmp_path), rectify=False)
    np.testing.assert_array_equal(sequence.frame(2), texture(60, 94, 2))
    assert (sequence.camera(0), sequence.right(0), sequence.baseline()) == (None, None, None)
    np.testing.assert_allclose(sequence.pose(2), body_pose(0.1) @ T_BODY_CAMERA[0], atol=1e-6)


def keep_states(mav0: Path, first: int, last: int) -> None:
    file = mav0 / "state_groundtruth_estimate0" / "data.csv"
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([head, *rows[first:last]]) + "\n")


def test_frames_without_a_pose_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    mav0 = make_euroc(tmp_path / "V1")
    keep_states(mav0, 9, 22)  # 45 to 105 ms: images 1 and 2 of 0, 50, 100 and 150 ms
    with caplog.at_level(logging.WARNING):
        (sequence,) = euroc(mav0)
    assert [sequence.pose(i) is None for i in range(4)] == [True, False, False, True]
    assert caplog.messages == ["V1: 2 of 4 frames have no pose within 0.005 s"]
    assert [p is None for p in map(euroc(mav0, tolerance=0.05)[0].pose, range(4))] == [False] * 4


def test_truth_of_another_time(tmp_path: Path):
    mav0 = make_euroc(tmp_path)
    keep_states(mav0, 2, 8)  # between two images
    with pytest.raises(
        BadInputError, match=r"ground truth does not overlap in time within data\.tolerance=0\.005"
    ) as caught:
        euroc(mav0)
    assert "\n" not in str(caught.value)


def test_without_truth(tmp_path: Path):
    mav0 = make_euroc(tmp_path)
    shutil.rmtree(mav0 / "state_groundtruth_estimate0")
    assert euroc(mav0)[0].pose(1) is None


def shift_times(mav0: Path, nanoseconds: int) -> None:
    times = [START + i * STEP for i in range(4)]
    rows = [f"{time + nanoseconds},{time}.png" for time in times]
    (mav0 / "cam1" / "data.csv").write_text("\n".join([rows[0], *rows[2:]]) + "\n")


def test_partners_are_found_by_time(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    mav0 = make_euroc(tmp_path / "V1")
    expected = [euroc(mav0)[0].right(i) for i in range(4)]
    shift_times(mav0, 2_000_000)
    with caplog.at_level(logging.WARNING):
        (sequence,) = euroc(mav0)
    assert caplog.messages == ["V1: 1 of 4 frames have no right image within 0.005 s"]
    assert sequence.right(1) is None
    for i in (0, 2, 3):
        np.testing.assert_array_equal(sequence.right(i), expected[i])


def test_wrong_folders_and_options(tmp_path: Path):
    (tmp_path / "photos").mkdir()
    with pytest.raises(BadInputError, match=r"no mav0 in .* or in its folders: .* has photos/; the layout of EuRoC"):
        euroc(tmp_path)
    with pytest.raises(BadInputError, match="does not exist"):
        euroc(tmp_path / "gone")
    with pytest.raises(BadInputError, match="tolerance is -1"):
        euroc(tmp_path, tolerance=-1)
    mav0 = make_euroc(tmp_path / "V1")
    cv2.imwrite(str(mav0 / "cam0" / "data" / f"{START}.png"), texture(30, 47))
    with pytest.raises(BadInputError, match=r"is 47x30, but its sensor\.yaml says 94x60"):
        euroc(mav0)[0].frame(0)
    (mav0 / "cam0" / "sensor.yaml").unlink()
    with pytest.raises(BadInputError, match=r"no .*sensor\.yaml: .*cam0 has data\.csv, data/; the layout of EuRoC"):
        euroc(mav0)


def test_cameras_of_different_size_or_order(tmp_path: Path):
    mav0 = make_euroc(tmp_path)
    file = mav0 / "cam1" / "sensor.yaml"
    whole = file.read_text()
    file.write_text(whole.replace("94, 60", "94, 62"))
    with pytest.raises(BadInputError, match="no stereo pair"):
        euroc(mav0)
    file.write_text(whole)
    (mav0 / "cam0").rename(mav0 / "other")
    (mav0 / "cam1").rename(mav0 / "cam0")
    (mav0 / "other").rename(mav0 / "cam1")
    with pytest.raises(BadInputError, match="not to the right"):
        euroc(mav0)


def test_fingerprint(tmp_path: Path):
    mav0 = make_euroc(tmp_path)
    prints = [euroc(mav0)[0].fingerprint, euroc(mav0.parent)[0].fingerprint]
    for options in ({"rectify": False}, {"tolerance": 0.01}, {"max_side": 40}):
        prints.append(euroc(mav0, **options)[0].fingerprint)
    for file in ("cam0/sensor.yaml", "cam1/data.csv", f"cam1/data/{START}.png", "state_groundtruth_estimate0/data.csv"):
        with (mav0 / file).open("ab") as stream:
            stream.write(b"\n")
        prints.append(euroc(mav0)[0].fingerprint)
    assert len(set(prints)) == len(prints) - 1


def test_pickles(tmp_path: Path):
    (sequence,) = euroc(make_euroc(tmp_path), max_side=50)
    other = pickle.loads(pickle.dumps(sequence))
    np.testing.assert_array_equal(other.right(1), sequence.right(1))


@pytest.mark.parametrize("rectify", [True, False])
def test_tum_vi(tmp_path: Path, rectify: bool):
    mav0 = make_euroc(tmp_path / "room1", columns=8)
    as_tum_vi(mav0)
    cv2.imwrite(str(mav0 / "cam0" / "data" / f"{START}.png"), np.full((60, 94), 3000, np.uint16))  # one is dull
    (sequence,) = euroc(tmp_path / "room1", rectify=rectify)
    assert (sequence.name, len(sequence)) == ("room1", 4)
    for i in range(4):
        turned = np.linalg.inv(sequence.pose(i)) @ (body_pose(i * STEP * 1e-9) @ T_BODY_CAMERA[0])
        np.testing.assert_allclose(turned[:3, 3], 0, atol=1e-6)
        assert np.degrees(np.arccos((np.trace(turned[:3, :3]) - 1) / 2)) < (3 if rectify else 1e-2)
    assert np.ptp(sequence.frame(0)) == 0  # one span for all images, not one for each
    assert 50 < sequence.frame(0).mean() < 150
    if rectify:
        assert sequence.camera(1).size == (94, 60)
        assert sequence.baseline() == pytest.approx(0.11, abs=1e-3)
        assert sequence.right(1).std() > 20
    else:
        grey = texture(60, 94, 1).astype(float)
        assert np.corrcoef(sequence.frame(1).ravel(), grey.ravel())[0, 1] > 0.999
        assert (sequence.camera(1), sequence.right(1)) == (None, None)


def test_as_stored_any_lens_will_do(tmp_path: Path):
    mav0 = make_euroc(tmp_path / "some")
    sensor = mav0 / "cam0" / "sensor.yaml"
    whole = euroc(mav0, rectify=False)[0]
    sensor.write_text(sensor.read_text().replace("radial-tangential", "fov"))
    with pytest.raises(BadInputError, match=r"distortion_model fov: .* data\.rectify=false"):
        euroc(mav0)
    (sequence,) = euroc(mav0, rectify=False)
    np.testing.assert_array_equal(sequence.frame(2), texture(60, 94, 2))
    np.testing.assert_array_equal(sequence.pose(2), whole.pose(2))
    sensor.unlink()
    with pytest.warns(InputWarning, match=r"there is no .*sensor\.yaml: .* no pose"):
        (sequence,) = euroc(mav0, rectify=False)
    np.testing.assert_array_equal(sequence.frame(2), texture(60, 94, 2))
    assert sequence.pose(2) is None
    with pytest.raises(BadInputError, match=r"there is no .*sensor\.yaml"):
        euroc(mav0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("T_cam_imu", "T_other", "no T_cam_imu for cam0"),
        ("T_cam_imu:\n  - [", "T_cam_imu:\n  - [.nan, 0, 0, 0]\n  # [", "no T_cam_imu for cam0"),
        ("T_cam_imu:\n  - [", "T_cam_imu:\n  - [.inf, 0, 0, 0]\n  # [", "no T_cam_imu for cam0"),
        ("T_cam_imu:\n  - [", "T_cam_imu:\n  - [9, 0, 0, 0]\n  # [", "no T_cam_imu for cam0"),
        ("cam0:", "cam5:", "no cam0"),
        ("distortion_coeffs: [0.0035, ", "distortion_coeffs: [", "distortion_coefficients"),
    ],
)
def test_bad_camchains(tmp_path: Path, old: str, new: str, message: str):
    as_tum_vi(make_euroc(tmp_path, columns=8))
    chain = tmp_path / "dso" / "camchain.yaml"
    chain.write_text(chain.read_text().replace(old, new, 1))
    with pytest.raises(BadInputError, match=rf"camchain\.yaml has {message}"):
        euroc(tmp_path)
