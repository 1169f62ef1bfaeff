from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
from image_files import write_images
from textured_scenes import flight, texture

from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.images import read_grey
from sips_lit.inference.streams import open_stream

COLOUR = np.dstack([texture(30, 44, seed) for seed in (1, 2, 3)])


def write(path: Path, image: np.ndarray) -> Path:
    """An RGB or grey image as a file."""
    assert cv2.imwrite(str(path), image[:, :, ::-1] if image.ndim == 3 else image)
    return path


def write_video(path: Path, count: int = 4, fps: float = 12.5, size: tuple[int, int] = (64, 48)) -> Path:
    """A colour video as users have them."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    for frame in flight(count, size=size).frames:
        writer.write(cv2.applyColorMap(frame, cv2.COLORMAP_JET))
    writer.release()
    return path


@pytest.mark.parametrize("colour", [False, True])
def test_one_image(tmp_path, colour):
    path = write(tmp_path / "one.png", COLOUR)
    stream = open_stream(path, colour)
    (frame,) = stream
    assert (stream.total, stream.fps) == (1, None)
    assert frame.name == "one"
    np.testing.assert_array_equal(frame.grey, read_grey(path))
    np.testing.assert_array_equal(frame.picture, COLOUR if colour else frame.grey)


def test_a_folder_of_mixed_images_in_natural_order(tmp_path):
    images = {"img2.png": COLOUR, "img10.PNG": texture(20, 25), "img1.bmp": texture(17, 31, 4)}
    for name, image in images.items():
        write(tmp_path / name, image)
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / ".img3.png").write_text("hidden")
    stream = open_stream(tmp_path, colour=True)
    frames = list(stream)
    assert stream.total == 3
    assert [frame.name for frame in frames] == ["img1", "img2", "img10"]
    for frame, name in zip(frames, ("img1.bmp", "img2.png", "img10.PNG"), strict=True):
        image = images[name]
        np.testing.assert_array_equal(frame.picture, image if image.ndim == 3 else np.dstack([image] * 3))
        assert frame.grey.shape == image.shape[:2]
        assert frame.grey.dtype == frame.picture.dtype == np.uint8
    assert [frame.name for frame in stream] == ["img1", "img2", "img10"]  # again


def test_sixteen_bits_and_transparency(tmp_path):
    grey = texture(20, 25)
    write(tmp_path / "deep.png", grey.astype(np.uint16) * 257)
    PIL.Image.fromarray(np.dstack([COLOUR, COLOUR[:, :, 0]])).save(tmp_path / "clear.png")
    clear, deep = open_stream(tmp_path, colour=True)
    np.testing.assert_array_equal(deep.grey, grey)
    np.testing.assert_array_equal(deep.picture, np.dstack([grey] * 3))
    np.testing.assert_array_equal(clear.picture, COLOUR)


def test_the_picture_lies_as_the_grey_image_does(tmp_path):
    orientation = PIL.Image.Exif()
    orientation[0x0112] = 6  # to be turned by a quarter
    PIL.Image.fromarray(COLOUR).save(tmp_path / "phone.jpg", exif=orientation, quality=100)
    (frame,) = open_stream(tmp_path, colour=True)
    assert frame.grey.shape == frame.picture.shape[:2] == (44, 30)  # upright
    luma = frame.picture @ np.array([0.299, 0.587, 0.114])
    assert np.abs(luma - frame.grey).max() < 12


def test_images_that_would_share_an_output_file(tmp_path):
    for name in ("a.png", "b.png", "b.jpg"):
        write(tmp_path / name, COLOUR)
    with pytest.raises(BadInputError, match=r"b\.jpg, b\.png in .* rename or move one"):
        open_stream(tmp_path, colour=False)


@pytest.mark.parametrize("colour", [False, True])
def test_a_damaged_image_stops_at_its_turn(tmp_path, colour):
    for index in range(3):
        write(tmp_path / f"{index}.png", texture(20, 25, index))
    (tmp_path / "1.png").write_bytes((tmp_path / "1.png").read_bytes()[:200])
    frames = iter(open_stream(tmp_path, colour))
    assert next(frames).name == "0"
    with pytest.raises(BadInputError, match=r"1\.png is not an image that OpenCV can read"):
        next(frames)


def test_pictures_of_other_depths_are_grey(tmp_path):
    write(tmp_path / "float.tiff", texture(20, 25) / np.float32(255))
    (frame,) = open_stream(tmp_path, colour=True)
    np.testing.assert_array_equal(frame.picture, np.dstack([frame.grey] * 3))


def test_one_range_for_a_folder_of_thermal_images(tmp_path):
    """A frame of little contrast among others keeps little contrast."""
    dark, bright = texture(60, 80), (texture(60, 80) // 8)
    for name, image in {"a": dark, "b": bright, "c": dark}.items():
        write(tmp_path / f"{name}.png", (28900 + image.astype(np.uint16) * 4))
    a, b, c = (frame.grey.astype(float) for frame in open_stream(tmp_path, colour=False))
    np.testing.assert_array_equal(a, c)
    assert a.std() > 0.7 * dark.std()
    assert b.std() == pytest.approx(a.std() / 8, rel=0.1)


def test_depth_maps_and_masks_are_no_frames(tmp_path):
    write_images(tmp_path / "a", "frame-{:06d}.color.png", "colour")
    write_images(tmp_path / "a", "frame-{:06d}.depth.png", "depth")
    with pytest.raises(BadInputError, match=r"set 'names=frame-\*\.color\.png' to read these alone"):
        open_stream(tmp_path / "a", colour=True)
    frames = list(open_stream(tmp_path / "a", colour=True, names="frame-*.color.png"))
    assert [frame.name for frame in frames] == [f"frame-{i:06d}.color" for i in range(6)]
    write_images(tmp_path / "b", "r_{}.png", "colour")
    write_images(tmp_path / "b", "r_{}_depth_0001.png", "colour")
    with pytest.raises(BadInputError, match=r"set 'names=r_\*\.png'"):
        open_stream(tmp_path / "b", colour=True)
    for side in ("left", "right"):  # two cameras are no reason not to see their points
        write_images(tmp_path / "c", side + "{}.png", "grey")
    assert open_stream(tmp_path / "c", colour=True).total == 12


def test_a_deep_image_among_others_uses_its_own_range(tmp_path):
    write(tmp_path / "a photo.png", COLOUR)
    write(tmp_path / "thermal.png", 28900 + texture(60, 80).astype(np.uint16) * 4)
    _, deep = open_stream(tmp_path, colour=False)
    assert deep.grey.std() > 0.7 * texture(60, 80).std()


def test_nothing_to_read(tmp_path):
    with pytest.raises(BadInputError, match="holds no images"):
        open_stream(tmp_path, colour=False)
    with pytest.raises(BadInputError, match=r"there is no .*gone\.png: give an image"):
        open_stream(tmp_path / "gone.png", colour=False)
    for name, content in (("notes.txt", b"text"), ("empty.mp4", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BadInputError, match=f"{name} is (no video|neither an image nor a video) that can be read"):
            open_stream(tmp_path / name, colour=False)


def test_a_video(tmp_path):
    path = write_video(tmp_path / "drive.avi")
    stream = open_stream(path, colour=False)
    assert stream.total == 4
    assert stream.fps == pytest.approx(12.5)
    frames = list(stream)
    assert [frame.name for frame in frames] == [f"drive_{index:06d}" for index in range(4)]
    capture = cv2.VideoCapture(str(path))
    for frame in frames:
        decoded = capture.read()[1]
        np.testing.assert_array_equal(frame.picture, decoded[:, :, ::-1])
        assert np.abs(frame.grey - frame.picture @ np.array([0.299, 0.587, 0.114])).max() <= 1
    capture.release()
    assert len(list(stream)) == 4  # again from the start


def test_a_damaged_video_is_told(tmp_path):
    path = write_video(tmp_path / "drive.avi", 8)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    stream = open_stream(path, colour=False)
    with pytest.warns(InputWarning, match=r"drive\.avi is damaged: it ends early"):
        count = len(list(stream))
    assert 2 <= count < 5
