import logging
import os
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from robotcar_files import DATE, START, STEP, colour_image, mosaic, write_run

from sips_lit.datasets.robotcar import BAYER, robotcar
from sips_lit.errors import BadInputError


def indices(sequence) -> list[int]:
    return [(int(file.stem) - START) // STEP for file in sequence.files]


@pytest.mark.parametrize("camera", BAYER)
def test_grey_images_of_raw_mosaics(tmp_path: Path, camera: str):
    write_run(tmp_path, 2, camera=camera)
    (sequence,) = robotcar(tmp_path, camera, crop_bottom=0)
    for i in range(2):
        grey = cv2.cvtColor(colour_image(i), cv2.COLOR_BGR2GRAY).astype(float)
        error = np.abs(sequence.frame(i) - grey)[2:-2, 2:-2]
        assert (sequence.frame(i).shape, sequence.frame(i).dtype) == ((96, 128), np.uint8)
        assert (error.mean(), error.max()) < (1, 6)
        others = [cv2.cvtColor(mosaic(colour_image(i), wrong), BAYER[camera]) for wrong in ("bggr", "grbg")]
        assert min(np.abs(other - grey)[2:-2, 2:-2].mean() for other in others) > 5  # the pattern matters


def test_names_times_and_cropping(tmp_path: Path):
    write_run(tmp_path)
    (sequence,) = robotcar(tmp_path, crop_bottom=30)
    assert (len(sequence), sequence.name) == (5, f"robotcar_{DATE}_stereo_centre")
    assert sequence.frame_name(1) == f"robotcar_{DATE}_stereo_centre_{START + STEP}"
    assert [sequence.time(i) for i in range(5)] == pytest.approx(
        [1405345790.123456 + 0.0625 * i for i in range(5)], abs=1e-6
    )
    (whole,) = robotcar(tmp_path, crop_bottom=0)
    np.testing.assert_array_equal(sequence.frame(2), whole.frame(2)[:66])
    assert robotcar(tmp_path, crop_bottom=32, max_side=64)[0].frame(0).shape == (32, 64)
    assert [sequence.camera(0), sequence.right(0), sequence.pose(0)] == [None] * 3


def test_a_run_by_any_of_its_folders(tmp_path: Path, monkeypatch):
    folder = write_run(tmp_path / "robotcar")
    names = [robotcar(place)[0].name for place in (folder, folder.parent, tmp_path, str(folder))]
    monkeypatch.chdir(folder)
    names.append(robotcar(".")[0].name)
    (tmp_path / "my run").symlink_to(folder)
    names.append(robotcar(tmp_path / "my run")[0].name)
    assert set(names) == {f"robotcar_{DATE}_stereo_centre"}


def test_archives_unpacked_side_by_side_are_one_run(tmp_path: Path):
    for number, there in ((1, [0, 1, 2]), (2, [3, 4, 5, 6]), (3, [7])):
        write_run(tmp_path / f"{DATE}_stereo_centre_{number:02d}", 8, there)
    (sequence,) = robotcar(tmp_path)
    assert indices(sequence) == list(range(8))


def test_missing_images_end_a_sequence(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    write_run(tmp_path, 12, [1, 2, 3, 5, 7, 8, 11])
    with caplog.at_level(logging.WARNING):
        sequences = robotcar(tmp_path)
    assert [indices(sequence) for sequence in sequences] == [[1, 2, 3], [7, 8]]
    assert [sequence.name[-15:] for sequence in sequences] == ["stereo_centre_0", "stereo_centre_1"]
    assert [record.getMessage() for record in caplog.records] == [
        f"robotcar {DATE}: 7 of 12 images of stereo/centre are there, in 4 stretches"
    ]
    caplog.clear()
    write_run(tmp_path / "whole")
    robotcar(tmp_path / "whole")
    assert not caplog.records


def test_long_gaps_end_a_sequence(tmp_path: Path):
    seconds = [0, 0.1, 1.1, 2.2, 2.3, 9, 10]
    write_run(tmp_path, times=[START + round(1e6 * second) for second in seconds])
    found = [[sequence.time(i) - START / 1e6 for i in range(len(sequence))] for sequence in robotcar(tmp_path)]
    assert [[round(second, 3) for second in part] for part in found] == [[0, 0.1, 1.1], [2.2, 2.3], [9, 10]]


def test_unsorted_and_doubled_timestamps(tmp_path: Path):
    folder = write_run(tmp_path)
    lines = (folder / "stereo.timestamps").read_text().splitlines()
    (folder / "stereo.timestamps").write_text("\n".join([*reversed(lines), lines[0], ""]))
    assert indices(robotcar(tmp_path)[0]) == [0, 1, 2, 3, 4]


def test_stride(tmp_path: Path):
    write_run(tmp_path, 12, [0, 1, 2, 3, 4, 5, 6, 8, 9])
    assert [indices(sequence) for sequence in robotcar(tmp_path, stride=3)] == [[0, 3, 6]]
    with pytest.raises(BadInputError, match=r"no two images in a row .* stereo/centre list \(at data\.stride=9\)"):
        robotcar(tmp_path, stride=9)


def test_runs_and_a_split(tmp_path: Path):
    other = "2015-02-03-08-45-10"
    for date in (DATE, other):
        write_run(tmp_path, date=date)
    assert [sequence.name for sequence in robotcar(tmp_path)] == [f"robotcar_{d}_stereo_centre" for d in (DATE, other)]
    assert [sequence.name for sequence in robotcar(tmp_path, split="train")] == [f"robotcar_{DATE}_stereo_centre"]
    with pytest.raises(BadInputError, match=rf"split=train needs {DATE}, and .* has {other}: download"):
        robotcar(tmp_path / other, split="train")
    with pytest.raises(BadInputError, match="split=test needs sequences, but names none"):
        robotcar(tmp_path, split="test")


def test_fingerprint_and_pickling(tmp_path: Path):
    folder = write_run(tmp_path)
    original = robotcar(tmp_path)[0]
    prints = {original.fingerprint}
    for options in ({"crop_bottom": 20}, {"max_side": 64}, {"stride": 2}):
        prints.add(robotcar(tmp_path, **options)[0].fingerprint)
    image = folder / "stereo/centre" / f"{START}.png"
    os.utime(image, ns=(0, 0))
    prints.add(robotcar(tmp_path)[0].fingerprint)
    assert len(prints) == 5
    (sequence,) = robotcar(tmp_path, crop_bottom=20)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(sequence)).frame(3), sequence.frame(3))


def test_bad_images_are_named(tmp_path: Path):
    folder = write_run(tmp_path) / "stereo/centre"
    (sequence,) = robotcar(tmp_path, crop_bottom=20)
    file = folder / f"{START}.png"
    good = file.read_bytes()
    for data in (good[: len(good) // 2], b"", b"text"):
        file.write_bytes(data)
        with pytest.raises(BadInputError, match=rf"{START}\.png is not an image that OpenCV can read, or is truncated"):
            sequence.frame(0)
    cv2.imwrite(str(file), colour_image())
    with pytest.raises(BadInputError, match=r"is not a raw image of one channel .* data=folder"):
        sequence.frame(0)
    file.unlink()
    with pytest.raises(BadInputError, match=r"cannot read the image .*: No such file"):
        sequence.frame(0)
    file.write_bytes(good)
    cv2.imwrite(str(folder / f"{START + STEP}.png"), np.zeros((64, 64), np.uint8))
    with pytest.raises(BadInputError, match=rf"{START + STEP}\.png is 64x64, but {START}\.png is 128x96"):
        sequence.frame(1)
    with pytest.raises(BadInputError, match=r"crop_bottom is 90, but the images are 96 pixels high"):
        robotcar(tmp_path, crop_bottom=90)[0].frame(0)


def test_what_is_missing_is_told(tmp_path: Path):
    with pytest.raises(
        BadInputError, match=r"no run with stereo/centre/ in .*gone: .* does not exist.*layout of RobotCar"
    ):
        robotcar(tmp_path / "gone")
    folder = write_run(tmp_path)
    with pytest.raises(BadInputError, match=rf"no run with mono_rear/ in .*: .* has {DATE}/; the layout of RobotCar"):
        robotcar(tmp_path, camera="mono_rear")
    (folder / "stereo.timestamps").rename(tmp_path / "away")
    with pytest.raises(
        BadInputError, match=r"there is no .*stereo\.timestamps, which every archive .*has stereo/; the"
    ):
        robotcar(tmp_path)
    for content, words in (
        (f"{START} 1\nsoon 1\n", r"line 2 of .*\.timestamps has 'soon', not a time in microseconds"),
        ("", "no two images"),
    ):
        (folder / "stereo.timestamps").write_text(content)
        with pytest.raises(BadInputError, match=words):
            robotcar(tmp_path)


def test_numbers_and_names_of_options(tmp_path: Path):
    write_run(tmp_path)
    for options, words in (
        ({"camera": "stereo"}, r"data\.camera is stereo: choose one of stereo/left, stereo/centre"),
        ({"crop_bottom": -1}, r"crop_bottom is -1"),
        ({"stride": 0}, r"data\.stride 0"),
        ({"max_side": 3}, r"max_side is 3"),
    ):
        with pytest.raises(BadInputError, match=words):
            robotcar(tmp_path, **options)
