import multiprocessing
import os
import pickle
import zipfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import texture
from tum_mono_files import NARROW, RESPONSE, SIZE, WIDE, vignette, write_sequence

from sips_lit.datasets.calibration import read_fov_camera
from sips_lit.datasets.tum_mono import tum_mono
from sips_lit.errors import BadInputError


@pytest.mark.parametrize("zipped", [True, False])
def test_images_times_and_names_as_published(tmp_path: Path, zipped: bool):
    write_sequence(tmp_path / "sequence_01", 4, zipped)
    (sequence,) = tum_mono(tmp_path)
    assert (len(sequence), sequence.name) == (4, "tum_mono_sequence_01")
    assert sequence.frame_name(3) == "tum_mono_sequence_01_00003"
    for i in range(4):
        coded = cv2.imencode(".jpg", texture(SIZE[1], SIZE[0], i))[1]
        np.testing.assert_array_equal(sequence.frame(i), cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE))
    assert [sequence.time(i) for i in range(4)] == pytest.approx([1464794230.5 + 0.05 * i for i in range(4)])
    assert sequence.camera(0) is None
    assert sequence.pose(0) is None


def test_all_sequences_one_of_them_and_a_split(tmp_path: Path, monkeypatch):
    for number in (1, 2, 48):
        write_sequence(tmp_path / f"sequence_{number:02d}", zipped=number != 2)
    (tmp_path / "calibration").mkdir()
    (tmp_path / "readme.txt").touch()
    names = [sequence.name for sequence in tum_mono(str(tmp_path))]
    assert names == [f"tum_mono_sequence_{number}" for number in ("01", "02", "48")]
    assert [sequence.name for sequence in tum_mono(tmp_path, split="all")] == names
    assert [sequence.name for sequence in tum_mono(tmp_path / "sequence_48")] == names[2:]
    monkeypatch.chdir(tmp_path / "sequence_48")
    assert [sequence.name for sequence in tum_mono(".")] == names[2:]
    with pytest.raises(
        BadInputError, match=r"split=train needs sequence_03, .* and 43 more, and .* has sequence_01, seq"
    ):
        tum_mono(tmp_path, split="train")
    with pytest.raises(BadInputError, match="split=test needs sequences, but names none"):
        tum_mono(tmp_path, split="test")
    with pytest.raises(BadInputError, match="no split dev"):
        tum_mono(tmp_path, split="dev")


def test_a_linked_folder_of_images(tmp_path: Path):
    folder = write_sequence(tmp_path / "sequence_01", zipped=False)
    (folder / "images").rename(tmp_path / "elsewhere")
    (folder / "images").symlink_to(tmp_path / "elsewhere")
    assert tum_mono(tmp_path)[0].frame(3).shape == (128, 160)


def test_photometric_correction(tmp_path: Path):
    light = np.tile(np.linspace(20, 180, SIZE[0]), (SIZE[1], 1))
    recorded = np.round(255 * (light * vignette() / 255) ** (1 / 2.2)).astype(np.uint8)
    write_sequence(tmp_path / "sequence_01", images=[recorded, recorded])
    (sequence,) = tum_mono(tmp_path, photometric=True)
    assert np.abs(sequence.frame(0) - light).max() < 3
    slow = np.clip(np.round(RESPONSE[recorded] / vignette()), 0, 255)
    assert np.abs(sequence.frame(0) - slow).max() <= 1
    assert sequence.camera(0) is None


@pytest.mark.parametrize("lens", [NARROW, WIDE])
def test_rectified_images_match_their_camera(tmp_path: Path, lens: str):
    """Every pixel has the colour of the ray that the returned camera gives it, in a scene of known light."""
    file = write_sequence(tmp_path / "made", camera=f"{lens}\n160 128\ncrop\n80 60\n") / "camera.txt"
    lens_camera = read_fov_camera(file)

    def light(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 127 + 60 * np.sin(2 * np.arctan(x)) + 60 * np.cos(2 * np.arctan(y))

    columns, rows = np.meshgrid(np.arange(160.0), np.arange(128.0))
    rays = lens_camera.undistort(np.column_stack([columns.ravel(), rows.ravel()]))
    image = np.nan_to_num(light(*rays.T)).round().astype(np.uint8).reshape(128, 160)
    folder = write_sequence(tmp_path / "sequence_01", images=[image] * 2, camera=file.read_text())
    for max_side, size in ((None, (80, 60)), (40, (40, 30))):
        (sequence,) = tum_mono(folder, geometric=True, max_side=max_side)
        camera = sequence.camera(1)
        assert camera.size == size == sequence.frame(0).shape[::-1]
        columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        pixels = np.stack([columns, rows, np.ones_like(columns)], -1).astype(float)
        x, y, _ = np.moveaxis(pixels @ np.linalg.inv(camera.matrix).T, -1, 0)
        error = np.abs(sequence.frame(0) - light(x, y))
        assert (error.mean(), np.quantile(error, 0.99)) < (1.5, 5)
        assert sequence.frame(0).min() > 0


def test_both_corrections_photometric_first(tmp_path: Path):
    write_sequence(tmp_path / "sequence_01")
    (both,), (light,), (shape,) = (tum_mono(tmp_path, *flags) for flags in ((True, True), (True, False), (False, True)))
    np.testing.assert_array_equal(both.frame(1), shape._rectification(light.frame(1)))


def test_max_side_without_corrections(tmp_path: Path):
    write_sequence(tmp_path / "sequence_01")
    assert tum_mono(tmp_path, max_side=80)[0].frame(0).shape == (64, 80)
    with pytest.raises(BadInputError, match="max_side is 8"):
        tum_mono(tmp_path, max_side=8)


def test_fingerprints(tmp_path: Path):
    folder = write_sequence(tmp_path / "sequence_01")
    original = tum_mono(tmp_path)[0].fingerprint
    assert tum_mono(folder)[0].fingerprint == original
    options = [{"photometric": True}, {"geometric": True}, {"max_side": 80}, {"photometric": True, "geometric": True}]
    prints = {original, *(tum_mono(folder, **option)[0].fingerprint for option in options)}
    assert len(prints) == 5
    stat = (folder / "pcalib.txt").stat()
    os.utime(folder / "pcalib.txt", ns=(stat.st_atime_ns, stat.st_mtime_ns + 10**9))
    assert tum_mono(folder)[0].fingerprint == original  # not used
    assert tum_mono(folder, photometric=True)[0].fingerprint not in prints


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_workers_read_the_same_frames(tmp_path: Path, context: str):
    write_sequence(tmp_path / "sequence_01")
    (sequence,) = tum_mono(tmp_path, photometric=True, geometric=True)
    expected = [sequence.frame(i) for i in range(4)]
    assert len(pickle.dumps(sequence)) < 10_000
    with ProcessPoolExecutor(1, multiprocessing.get_context(context)) as processes:
        np.testing.assert_array_equal(list(processes.map(sequence.frame, range(4))), expected)


def test_what_is_missing_is_told(tmp_path: Path):
    with pytest.raises(
        BadInputError, match=r"no sequence in .*gone: the folder .* does not exist.*the layout of TUM mono"
    ):
        tum_mono(tmp_path / "gone")
    (tmp_path / "photos").mkdir()
    with pytest.raises(
        BadInputError, match=r"no sequence in .*: .* has photos/; the layout of TUM mono is sequence_01/"
    ):
        tum_mono(tmp_path)
    folder = write_sequence(tmp_path / "sequence_01")
    for name, options in (("vignette.png", {"photometric": True}), ("camera.txt", {"geometric": True})):
        (folder / name).rename(tmp_path / "away")
        assert len(tum_mono(folder)[0]) == 4
        with pytest.raises(BadInputError, match=rf"there is no .*{name}: .*sequence_01 has "):
            tum_mono(folder, **options)
        (tmp_path / "away").rename(folder / name)
    for name in ("times.txt", "images.zip"):
        (folder / name).rename(tmp_path / "away")
        with pytest.raises(BadInputError, match=rf"there is no .*{name}: .*the layout of TUM mono"):
            tum_mono(tmp_path)
        (tmp_path / "away").rename(folder / name)


def test_times_that_do_not_fit(tmp_path: Path):
    folder = write_sequence(tmp_path / "sequence_01")
    lines = (folder / "times.txt").read_text().splitlines()
    for changed, words in (
        (lines[:3], r"times\.txt has 3 rows, but there are 4 images"),
        ([*lines, "00004 1464794231.0 2.0"], r"times\.txt has 5 rows, but there are 4 images"),
        ([*lines[:3], "00003"], r"line 4 of .*times\.txt has 1 values: number, time in seconds"),
        ([*lines[:3], "00003 soon 2.0"], r"line 4 of .*times\.txt has 'soon'"),
    ):
        (folder / "times.txt").write_text("\n".join(changed))
        with pytest.raises(BadInputError, match=words):
            tum_mono(folder)
    (folder / "times.txt").write_text("\n".join(line.rsplit(" ", 1)[0] for line in lines))
    assert tum_mono(folder)[0].time(1) == pytest.approx(1464794230.55)  # no exposure times


def test_images_of_another_camera_and_damaged_archives(tmp_path: Path):
    folder = write_sequence(tmp_path / "sequence_01", images=[texture(64, 80)] * 2)
    assert tum_mono(folder)[0].frame(0).shape == (64, 80)
    with pytest.raises(BadInputError, match=r"image 00000 of .* is 80x64, but line 2 of its camera\.txt says 160x128"):
        tum_mono(folder, geometric=True)[0].frame(0)
    cv2.imwrite(str(folder / "vignette.png"), np.ones((64, 80), np.uint16))
    with pytest.raises(BadInputError, match=r"vignette\.png is 80x64, but the images are 160x128"):
        tum_mono(folder, photometric=True)
    with zipfile.ZipFile(folder / "images.zip", "w"):
        pass
    with pytest.raises(BadInputError, match=r"images\.zip has no image"):
        tum_mono(folder)
    (folder / "images.zip").write_bytes(b"<html>404</html>")
    with pytest.raises(BadInputError, match=r"images\.zip is not a zip archive"):
        tum_mono(folder)
