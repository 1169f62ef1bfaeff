import os
import pickle
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from image_files import write_images
from textured_scenes import texture

from sips_lit.errors import BadInputError, InputWarning
from sips_lit.files import safe_name
from sips_lit.frames.folder import folder


def fill(place: Path, count: int = 3, size: tuple[int, int] = (48, 64), seed: int = 0, name: str = "{}.png") -> Path:
    place.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        assert cv2.imwrite(str(place / name.format(i)), texture(*size, seed + i))
    return place


def test_frames_in_order(tmp_path: Path):
    (sequence,) = folder(fill(tmp_path / "walk", 12))
    assert (len(sequence), sequence.name, sequence.frame_name(10)) == (12, "walk", "10")
    for i in range(12):
        np.testing.assert_array_equal(sequence.frame(i), texture(48, 64, i))


def test_max_side_shrinks_and_never_enlarges(tmp_path: Path):
    fill(tmp_path)
    (small,), (same,) = folder(tmp_path, max_side=32), folder(str(tmp_path), max_side=100)
    assert small.frame(1).shape == (24, 32)
    np.testing.assert_array_equal(same.frame(1), texture(48, 64, 1))


def test_subfolders_are_sequences(tmp_path: Path):
    root = tmp_path / "trips"
    fill(root / "b c", seed=5)
    fill(root / "a")
    (root / "empty").mkdir()
    (root / "notes.txt").touch()
    sequences = folder(root)
    assert [sequence.name for sequence in sequences] == ["trips_a", "trips_b_c"]
    np.testing.assert_array_equal(sequences[1].frame(0), texture(48, 64, 5))


def test_images_of_the_folder_itself_go_before_its_subfolders(tmp_path: Path):
    fill(tmp_path / "walk")
    fill(tmp_path / "walk" / "thumbnails")
    assert [len(sequence) for sequence in folder(tmp_path / "walk")] == [3]


def test_names_are_unique_and_safe(tmp_path: Path):
    places = [fill(tmp_path / place) for place in ("x/cam", "y/cam", "z/cam_2", "z/cam 2", "u/cam")]
    names = [sequence.name for sequence in folder(places)]
    assert len(set(names)) == 5
    assert names[:2] == ["cam", "cam_2"]
    assert all(name == safe_name(name) for name in names)


def test_names_of_subfolders_that_differ_in_unsafe_letters_only(tmp_path: Path):
    for place in ("a b", "a+b", "a_b"):
        fill(tmp_path / "trips" / place)
    assert len({sequence.name for sequence in folder(tmp_path / "trips")}) == 3


@pytest.mark.parametrize(
    ("name", "safe"), [("a b/c", "a_b_c"), ("", "sequence"), ("été-1.0", "été-1.0"), ("x:*?<>|y", "x_y")]
)
def test_safe_name(name: str, safe: str):
    assert safe_name(name) == safe


def test_fingerprint(tmp_path: Path):
    place = fill(tmp_path / "walk")
    original = folder(place)[0].fingerprint
    assert folder(str(place))[0].fingerprint == original
    shutil.copytree(place, tmp_path / "copy" / "walk")  # keeps the times
    assert folder(tmp_path / "copy" / "walk")[0].fingerprint == original
    (place / "notes.txt").touch()
    assert folder(place)[0].fingerprint == original

    prints = {original, folder(place, max_side=32)[0].fingerprint, folder(place, max_side=33)[0].fingerprint}
    times = (place / "1.png").stat()
    content = (place / "1.png").read_bytes()
    (place / "1.png").write_bytes(content + b"1")
    os.utime(place / "1.png", ns=(times.st_atime_ns, times.st_mtime_ns))
    prints.add(folder(place)[0].fingerprint)  # another size
    (place / "1.png").write_bytes(content)
    os.utime(place / "1.png", ns=(times.st_atime_ns, times.st_mtime_ns + 1_000_000_000))
    prints.add(folder(place)[0].fingerprint)  # another time
    (place / "2.png").rename(place / "4.png")
    prints.add(folder(place)[0].fingerprint)
    (place / "4.png").unlink()
    prints.add(folder(place)[0].fingerprint)
    assert len(prints) == 7


def test_pickles(tmp_path: Path):
    (sequence,) = folder(fill(tmp_path), max_side=32)
    sequence.frame(2)
    other = pickle.loads(pickle.dumps(sequence))
    assert (other.name, other.fingerprint, len(other)) == (sequence.name, sequence.fingerprint, 3)
    np.testing.assert_array_equal(other.frame(1), sequence.frame(1))


def test_missing_file_empty_and_single(tmp_path: Path):
    with pytest.raises(BadInputError, match=r"there is no folder .*gone"):
        folder(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInputError, match=r"empty has no images"):
        folder(tmp_path / "empty")
    fill(tmp_path / "single", 1)
    with pytest.raises(BadInputError, match=r"single has one image only"):
        folder(tmp_path / "single")
    with pytest.raises(BadInputError, match=r"0\.png is a file"):
        folder(tmp_path / "single" / "0.png")


def test_bad_lists_and_numbers(tmp_path: Path):
    with pytest.raises(BadInputError, match="list of folders is empty"):
        folder([])
    with pytest.raises(BadInputError, match="gone"):
        folder([fill(tmp_path / "walk"), tmp_path / "gone"])
    for max_side in (0, -5, 15):
        with pytest.raises(BadInputError, match=f"max_side is {max_side}"):
            folder(tmp_path / "walk", max_side)


def test_unreadable_image_in_the_middle(tmp_path: Path):
    (tmp_path / "1.png").write_text("oops")
    fill(tmp_path, name="{}.bmp")
    (sequence,) = folder(tmp_path)
    assert [sequence.frame_name(i) for i in range(4)] == ["0", "1", "1", "2"]
    np.testing.assert_array_equal(sequence.frame(0), texture(48, 64, 0))
    with pytest.raises(BadInputError, match=r"1\.png is not an image"):
        sequence.frame(2)


def test_a_link_that_leads_nowhere_is_an_unreadable_image(tmp_path: Path):
    fill(tmp_path)
    before = folder(tmp_path)[0].fingerprint
    (tmp_path / "1.png").unlink()
    (tmp_path / "1.png").symlink_to(tmp_path / "away.png")
    (sequence,) = folder(tmp_path)
    assert [sequence.frame_name(i) for i in range(3)] == ["0", "1", "2"]
    assert sequence.fingerprint != before
    with pytest.raises(BadInputError, match=r"cannot read the image .*1\.png"):
        sequence.frame(1)


def test_mixed_sizes(tmp_path: Path):
    fill(tmp_path, 3)
    cv2.imwrite(str(tmp_path / "1.png"), texture(64, 48))
    for order in ((0, 1), (1,), (2, 1)):  # whichever frame is asked for first
        (sequence,) = folder(tmp_path)
        for index in order[:-1]:
            sequence.frame(index)
        with pytest.raises(BadInputError, match=r"1\.png is 48x64, but 0\.png is 64x48"):
            sequence.frame(order[-1])


def test_sizes_are_compared_before_shrinking(tmp_path: Path):
    fill(tmp_path, 2)
    cv2.imwrite(str(tmp_path / "1.png"), texture(96, 128))
    with pytest.raises(BadInputError, match="must have one size"):
        folder(tmp_path, max_side=32)[0].frame(1)


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 2, 1)])
def test_a_damaged_first_image_leaves_the_others_readable(tmp_path: Path, order):
    fill(tmp_path, 4)
    (tmp_path / "0.png").write_bytes(b"\x89PNG")
    cv2.imwrite(str(tmp_path / "2.png"), texture(20, 30))
    (sequence,) = folder(tmp_path)
    for i in order:
        if i == 2:
            with pytest.raises(BadInputError, match=r"2\.png is 30x20, but 1\.png is 64x48"):
                sequence.frame(i)
        else:
            np.testing.assert_array_equal(sequence.frame(i), texture(48, 64, i))
    with pytest.raises(BadInputError, match=r"0\.png is not an image"):
        sequence.frame(0)


def test_colour_and_depth_in_one_folder(tmp_path: Path):
    write_images(tmp_path, "frame-{:06d}.color.png", "colour")
    write_images(tmp_path, "frame-{:06d}.depth.png", "depth")
    with pytest.raises(
        BadInputError, match=r"different kinds, 6 frame-\*\.color\.png \(8-bit colour\).*16-bit"
    ) as caught:
        folder(tmp_path)
    assert "set 'data.names=frame-*.color.png' to read these alone" in str(caught.value)
    with pytest.warns(InputWarning, match="6 files are no frames"):
        (sequence,) = folder(tmp_path, names="frame-*.color.png")
    assert len(sequence) == 6
    assert {file.name.split(".")[1] for file in sequence.files} == {"color"}
    with pytest.raises(BadInputError, match=r"no images named left\*\.png .*but frame-\*\.color\.png"):
        folder(tmp_path, names="left*.png")
    assert len(folder(fill(tmp_path / "digits", name="{}_mask.png"), names="*_mask.png")[0]) == 3


def test_two_cameras_in_one_folder(tmp_path: Path):
    for camera in (0, 1, 2):
        write_images(tmp_path, f"cam{camera}_{{:03d}}.png", "grey")
    with pytest.raises(BadInputError, match=r"set 'data\.names=cam0_\*\.png' or 'data\.names=cam1_\*\.png' or"):
        folder(tmp_path)
    with pytest.warns(InputWarning, match="12 files are no frames"):
        (sequence,) = folder(tmp_path, names="cam1_*.png")
    assert [sequence.frame_name(i) for i in range(6)] == [f"cam1_{i:03d}" for i in range(6)]


def test_8_and_16_bits_of_one_name(tmp_path: Path):
    write_images(tmp_path, "{}.png", "grey", range(3))
    write_images(tmp_path, "{}.png", "depth", range(3, 6))
    with pytest.raises(BadInputError, match=r"8-bit and 16-bit grey\): put each kind into a folder of its own"):
        folder(tmp_path)


def test_folders_of_colour_and_depth(tmp_path: Path):
    write_images(tmp_path / "rgb", "{}.png", "colour")
    write_images(tmp_path / "depth", "{}.png", "depth")
    with pytest.raises(
        BadInputError, match=r"6 depth \(16-bit grey\), 6 rgb \(8-bit colour\).*rgb, or a list"
    ) as caught:
        folder(tmp_path)
    assert f"data.path={tmp_path / 'rgb'}" in str(caught.value)
    assert f"data.path={tmp_path / 'depth'}" not in str(caught.value)
    assert [len(sequence) for sequence in folder([tmp_path / "rgb", tmp_path / "depth"])] == [6, 6]  # as one asks for


@pytest.mark.parametrize("strays", [["preview.png"], ["a.png", "b.png"]])
def test_pictures_beside_folders_of_frames(tmp_path: Path, strays: list[str]):
    for name in ("one", "two"):
        fill(tmp_path / "trips" / name, 4)
    for name in strays:
        cv2.imwrite(str(tmp_path / "trips" / name), texture(20, 20))
    with pytest.warns(InputWarning, match=f"its own are not: {strays[0]}"):
        sequences = folder(tmp_path / "trips")
    assert [(s.name, len(s)) for s in sequences] == [("trips_one", 4), ("trips_two", 4)]


def test_what_is_no_frame_in_a_folder_and_no_sequence_in_a_root(tmp_path: Path):
    fill(tmp_path / "trips" / "one", 4)
    cv2.imwrite(str(tmp_path / "trips" / "one" / "preview.png"), texture(20, 20))
    fill(tmp_path / "trips" / "cover", 1)
    for hidden in (".ipynb_checkpoints", "__MACOSX", "@eaDir"):
        write_images(tmp_path / "trips" / hidden, "{}.png", "depth")
        write_images(tmp_path / "trips" / "one" / hidden, "{}.png", "depth")
    with pytest.warns(InputWarning) as warned:
        (sequence,) = folder(tmp_path / "trips")
    assert [sequence.frame(i).shape for i in range(len(sequence))] == [(48, 64)] * 4
    assert [str(w.message).split(": ", 1)[1] for w in warned] == [
        "folders of one image make no pair and are not read: cover",
        "1 files are no frames and are not read: preview.png",
    ]
