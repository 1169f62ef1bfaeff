from pathlib import Path

import numpy as np
import pytest
from euroc_files import LENSES, START, STEP, T_BODY_CAMERA, body_pose, make_euroc

from sips_lit.datasets.asl import read_sensor, read_states, read_timed_images
from sips_lit.errors import BadInputError


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("header", ["%YAML:1.0\n", "", "%YAML 1.2\n---\n"])
def test_sensor(tmp_path: Path, header: str):
    file = make_euroc(tmp_path) / "cam1" / "sensor.yaml"
    replace(file, "%YAML:1.0\n", header)
    replace(file, "T_BS:\n", "T_BS: !!opencv-matrix\n")
    lens, T = read_sensor(file)
    np.testing.assert_allclose(lens.matrix, LENSES[1].matrix)
    np.testing.assert_allclose(lens.distortion, LENSES[1].distortion)
    assert lens.size == (94, 60)
    np.testing.assert_allclose(T, T_BODY_CAMERA[1])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radial-tangential", "fov", "with distortion_model fov: only pinhole .* data.rectify=false"),
        ("camera_model: pinhole", "", "camera_model None"),
        ("[57.3, ", "[", r"has intrinsics: \[57\.1, .* list of 4 finite numbers"),
        ("[57.3, ", "[.nan, ", "has intrinsics"),
        ("[57.3, ", "[-57.3, ", "not positive"),
        ("[57.3, ", "[1e6, ", r"has focal lengths 1e\+06, 57\.1 and the centre .* can't be of images of 94x60"),
        ("[57.3, ", "[{a: 1}, ", "has intrinsics"),
        ("[57.3, ", "[1e999, ", "has intrinsics"),
        ("[57.3, ", f"[{'9' * 400}, ", "has intrinsics"),
        ("resolution:", "size:", "has resolution: None"),
        ("resolution: [94,", "resolution: [94.5,", r"has resolution: \[94\.5, 60\], which is no size"),
        ("resolution: [94,", "resolution: [1e9,", "which is no size of an image"),
        ("resolution: [94,", "resolution: [1e308,", "which is no size of an image"),
        ("T_BS:", "x: " + "[" * 3000 + "\nT_BS:", "not readable as YAML"),
        ("T_BS:", f"a: &a {{b: 1}}\nc: &c {{<<: [{'*a, ' * 99}*a]}}\nT_BS:", "not readable as YAML"),
        ("T_BS:", "# " + "x" * 2**20 + "\nT_BS:", "not readable as YAML: it is larger than 65536 bytes"),
        ("data: [", "data: [1, ", "has T_BS: data"),
        ("T_BS:", "T_BC:", "has T_BS: data: None"),
        ("sensor_type: camera", "sensor_type: [camera", "not readable as YAML"),
    ],
)
def test_bad_sensors(tmp_path: Path, old: str, new: str, message: str):
    file = make_euroc(tmp_path) / "cam0" / "sensor.yaml"
    replace(file, old, new)
    with pytest.raises(BadInputError, match=message) as caught:
        read_sensor(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_sensor_that_is_no_rigid_motion_or_empty(tmp_path: Path):
    file = make_euroc(tmp_path) / "cam0" / "sensor.yaml"
    replace(file, f"data: [{float(T_BODY_CAMERA[0][0, 0])!r}", "data: [2.0")
    with pytest.raises(BadInputError, match="no rigid motion"):
        read_sensor(file)
    make_euroc(tmp_path / "other")
    file = tmp_path / "other" / "mav0" / "cam0" / "sensor.yaml"
    replace(file, "0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 0.0, 0.0]")
    with pytest.raises(BadInputError, match="no rigid motion"):
        read_sensor(file)
    file.write_text("%YAML:1.0\n")
    with pytest.raises(BadInputError, match="has no keys"):
        read_sensor(file)


def test_timed_images(tmp_path: Path):
    camera = make_euroc(tmp_path) / "cam0"
    images = read_timed_images(camera)
    assert images.times.tolist() == [START + i * STEP for i in range(4)]
    assert images.files[1] == camera / "data" / f"{START + STEP}.png"
    images.files[2].unlink()
    with pytest.raises(BadInputError, match=rf"1 of 4 images .* is .*{START + 2 * STEP}\.png: download"):
        read_timed_images(camera)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#t\n12,a.png\nx,b.png\n", r"line 3 of .*data\.csv has 'x', not a time in nanoseconds"),
        ("12 a.png\n", "line 1 of .* is not a time in nanoseconds, a comma"),
        ("13,a.png\n12,b.png\n", r"line 2 of .*data\.csv is not later"),
        ("#t\n", "lists 0 images"),
        ("12,a.png\n13,../../b.png\n", r"line 2 of .*data\.csv names \.\./\.\./b\.png, which leaves the folder"),
        ("12,/etc/passwd\n", "leaves the folder"),
        (f"{'9' * 5000},a.png\n", "line 1 of .* not a time in nanoseconds"),
        (f"{2**63},a.png\n", "line 1 of .* not a time in nanoseconds"),
        (f"12,{'a' * 300}.png\n", "line 1 of .* is no name of a file"),
        ("12,a\0.png\n", "line 1 of .* is no name of a file"),
    ],
)
def test_bad_lists(tmp_path: Path, text: str, message: str):
    camera = make_euroc(tmp_path) / "cam0"
    (camera / "data.csv").write_text(text)
    with pytest.raises(BadInputError, match=message):
        read_timed_images(camera)


@pytest.mark.parametrize("columns", [8, 17])
def test_states(tmp_path: Path, columns: int):
    states = read_states(make_euroc(tmp_path, columns=columns) / "state_groundtruth_estimate0/data.csv")
    assert len(states.times) == 40
    assert np.abs(states.times[[0, 7]] - [START, START + 35_000_000]).max() < 500
    for i in (0, 7, 39):
        np.testing.assert_allclose(states.T_world_body[i], body_pose(i * 0.005), atol=1e-6)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("{t},0,0,0,1,0,0", "has 7 values, not 17 or 8"),
        ("{t},0,0,nan,1,0,0,0", r"line 2 of .*data\.csv has 'nan'"),
        ("{t},0,0,0,0.5,0,0,0", r"line 2 of .*data\.csv has a quaternion of length 0\.5"),
        ("{t},1e300,0,0,1,0,0,0", r"line 2 of .*data\.csv has a position that is no place on earth"),
        ("1e300,0,0,0,1,0,0,0", r"line 2 of .*data\.csv begins with 1e\+300, not a time in nanoseconds"),
        ("12,0,0,0,1,0,0,0", r"line 2 of .*data\.csv is not later"),
    ],
)
def test_bad_states(tmp_path: Path, row: str, message: str):
    file = tmp_path / "data.csv"
    file.write_text(f"{START},0,0,0,1,0,0,0\n" + row.format(t=START + STEP))
    with pytest.raises(BadInputError, match=message):
        read_states(file)


def test_yaml_that_unfolds_to_terabytes_is_not_quoted(tmp_path: Path):
    """Names for lists of lists, each ten times the one before, as in the attack of a billion laughs."""
    file = make_euroc(tmp_path) / "cam0" / "sensor.yaml"
    folded = ["a0: &a0 [1]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    text = file.read_text().replace("T_BS:", "\n".join(folded) + "\nT_BS:")
    file.write_text(text.replace("resolution: [94, 60]", "resolution: *a11"))
    with pytest.raises(BadInputError, match="has resolution: ") as caught:
        read_sensor(file)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_sensor_that_windows_wrote(tmp_path: Path, encoding: str):
    file = make_euroc(tmp_path) / "cam0" / "sensor.yaml"
    lens, _ = read_sensor(file)
    file.write_text(file.read_text(), encoding=encoding)
    np.testing.assert_array_equal(read_sensor(file)[0].matrix, lens.matrix)
