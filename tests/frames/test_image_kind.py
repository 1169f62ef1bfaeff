from pathlib import Path

import cv2
import numpy as np
import pytest
from image_files import picture, write_images
from PIL import Image

from sips_lit.frames.image_kind import frames_among, group_of, in_folders, in_one_folder, without_strays
from sips_lit.frames.listing import list_images

TIMES = [1305031102.175304 + 0.033 * i for i in range(6)]
# what lies in one folder, and the names of what are frames; None where nobody can tell
DIFFERENT = {
    "7-Scenes": ([("frame-{:06d}.color.png", "colour"), ("frame-{:06d}.depth.png", "depth")], "frame-*.color.png"),
    "Replica": ([("frame{:06d}.jpg", "colour"), ("depth{:06d}.png", "depth")], "frame*.jpg"),
    "depth in 8 bits": ([("frame{:06d}.png", "colour"), ("depth{:06d}.png", "grey")], "frame*.png"),
    "stereo": ([("left{:04d}.png", "grey"), ("right{:04d}.png", "grey")], "left*.png"),
    "masks": ([("{:04d}.png", "colour"), ("{:04d}_mask.png", "mask")], "*.png"),
    "masks of one name": ([("{:04d}.jpg", "colour"), ("{:04d}.png", "mask")], "*.jpg"),
    "masks of a grey camera": ([("img_{:04d}.png", "grey"), ("mask_{:04d}.png", "mask")], "img_*.png"),
    "names of Blender": ([("r_{}.png", "colour"), ("r_{}_depth_0001.png", "colour")], "r_*.png"),
    "words in one": ([("rgbImage{:03d}.png", "colour"), ("depthMap{:03d}.png", "colour")], "rgbImage*.png"),
    "two cameras": ([("cam0_{:03d}.png", "grey"), ("cam1_{:03d}.png", "grey")], None),
    "cameras last": ([("{:06d}_0.png", "grey"), ("{:06d}_1.png", "grey")], None),
    "unknown words": ([("one{:04d}.png", "grey"), ("two{:04d}.png", "grey")], None),
}


@pytest.mark.parametrize("case", DIFFERENT)
def test_kinds_in_one_folder(tmp_path: Path, case: str):
    kinds, frames = DIFFERENT[case]
    for name, kind in kinds:
        write_images(tmp_path, name, kind)
    conflict = in_one_folder(list_images(tmp_path))
    assert len(conflict) == 2
    found = [group.name for group in frames_among(conflict)]
    assert found == ([frames] if frames else [group.name for group in conflict])


def test_times_that_mix(tmp_path: Path):
    for name, shift in (("left_{:.6f}.png", 0.0), ("right_{:.6f}.png", 0.011)):
        write_images(tmp_path, name, "grey", [time + shift for time in TIMES])
    conflict = in_one_folder(list_images(tmp_path))
    assert [group.name for group in frames_among(conflict)] == ["left_*.*.png"]


def test_bits_that_differ_within_a_pattern(tmp_path: Path):
    write_images(tmp_path, "{:04d}.png", "grey", range(0, 200, 2), (4, 4))
    write_images(tmp_path, "{:04d}.png", "depth", range(1, 200, 2), (4, 4))  # every other file
    (group,) = in_one_folder(list_images(tmp_path))
    assert str(group) == "200 *.png (8-bit and 16-bit grey)"
    write_images(tmp_path / "two", "image.png", "grey", [0])
    write_images(tmp_path / "two", "range.png", "depth", [0])
    assert in_one_folder(list_images(tmp_path / "two"))


ALIKE = {
    "colour": [("{:04d}.png", "colour", range(9))],
    "depth alone": [("{:04d}.png", "depth", range(9))],  # a thermal camera, say
    "a few grey": [("f{:03d}.jpg", "colour", range(40)), ("f{:03d}.jpg", "grey", (3, 17, 18))],
    "half grey": [("f{:03d}.jpg", "colour", range(20)), ("f{:03d}.jpg", "grey", range(0, 20, 2))],
    "HPatches": [("{}.ppm", "colour", range(1, 7))],
    "HPatches with another 1": [("{}.ppm", "colour", range(1, 7)), ("{}.jpg", "colour", (1,))],
    "two parts": [("a{:03d}.png", "grey", range(9)), ("b{:03d}.png", "grey", range(9, 20))],
    "one file of another format": [("{:04d}.jpg", "colour", range(9)), ("{:04d}.png", "colour", (9,))],
    "two cameras one after the other": [
        ("cam0_{:02d}.png", "grey", range(9)),
        ("cam1_{:02d}.png", "grey", range(9, 20)),
    ],
    "scenes": [("scene1_{:02d}.png", "grey", range(9)), ("scene2_{:02d}.png", "grey", range(9))],
    "tenths of seconds": [(f"15482664{i:02d}" + "_{}.png", "grey", range(0, 10, 2)) for i in range(4)],
    "pairs of KITTI": [("{:06d}_10.png", "grey", range(9)), ("{:06d}_11.png", "grey", range(9))],
    "words": [("church{}.jpg", "colour", ("",)), ("tower{}.jpg", "grey", ("",)), ("bridge{}.jpg", "colour", ("",))],
    "hashes": [(f"{0x3FA9B1 * i:x}" + "{}.png", "colour" if i % 3 else "grey", ("",)) for i in range(1, 30)],
}


@pytest.mark.parametrize("case", ALIKE)
def test_what_is_one_sequence(tmp_path: Path, case: str):
    for name, kind, numbers in ALIKE[case]:
        for number in numbers:
            cv2.imwrite(str(tmp_path / name.format(number)), picture(kind, 7))
    assert in_one_folder(list_images(tmp_path)) == []


def images_in(root: Path) -> dict[str, list[Path]]:
    return {place.name: list_images(place) for place in sorted(root.iterdir())}


FOLDERS = {
    "TUM without lists": ({"rgb": ("{:04d}.png", "colour"), "depth": ("{:05d}.png", "depth")}, ["rgb"]),
    "depth in 8 bits": ({"color": ("{:04d}.jpg", "colour"), "depth": ("{:04d}.png", "grey")}, ["color"]),
    "masks": ({"images": ("{:04d}.jpg", "grey"), "masks": ("{:04d}.png", "mask")}, ["images"]),
    "coloured depth": ({"image": ("{:04d}.png", "colour"), "depth_vis": ("{:04d}.png", "colour")}, ["image"]),
    "infrared": ({"rgb": ("{:04d}.png", "colour"), "ir": ("{:04d}.png", "grey")}, ["rgb"]),
    "sequences": ({"walk": ("{:04d}.png", "colour"), "drive": ("{:04d}.png", "colour")}, None),
    "stereo": ({"left": ("{:04d}.png", "grey"), "right": ("{:04d}.png", "grey")}, None),
    "a depth tour": ({"in_depth_tour": ("{:04d}.jpg", "colour"), "other": ("view{:03d}.jpg", "colour")}, None),
    "grey and colour recordings": ({"a": ("{:04d}.png", "colour"), "b": ("img{:04d}.png", "grey")}, None),
}


@pytest.mark.parametrize("case", FOLDERS)
def test_kinds_of_folders(tmp_path: Path, case: str):
    folders, frames = FOLDERS[case]
    for i, (folder, (name, kind)) in enumerate(folders.items()):
        write_images(tmp_path / folder, name, kind, range(6 + (case == "a depth tour") * 100 * i))
    if case == "a depth tour":
        for file in (tmp_path / "other").glob("view0*"):
            file.unlink()
    conflict = in_folders(images_in(tmp_path))
    assert bool(conflict) == (frames is not None)
    assert [group.name for group in frames_among(conflict)] == (frames or [])


def test_smaller_copies_are_no_sequences(tmp_path: Path):
    for folder, factor in (("images", 1), ("images_2", 2), ("images_4", 4)):
        write_images(tmp_path / folder, "frame_{:05d}.png", "colour", size=(48 // factor, 64 // factor))
    conflict = in_folders(images_in(tmp_path))
    assert [group.name for group in frames_among(conflict)] == ["images"]
    for place in tmp_path.iterdir():  # of one size they are recordings that are numbered
        write_images(place, "frame_{:05d}.png", "colour")
    assert in_folders(images_in(tmp_path)) == []


@pytest.mark.parametrize(
    ("names", "strays"),
    [
        (["f1.png", "f2.png", "f3.png", "preview.png"], {"preview.png"}),
        ([f"f{i}.png" for i in range(30)] + ["map_7.png"], {"map_7.png"}),
        ([f"f{i}.jpg" for i in range(30)] + ["f30.png"], set()),  # a frame in another format
        (["f1.png", "f2.png", "f3.png", "g1.png"], set()),
        (["church.png", "tower2.png", "bridge3.png"], set()),
        (["a.png", "b.png"], set()),
        ([], set()),
    ],
)
def test_strays_in_a_folder(names: list[str], strays: set[str]):
    files = [Path(name) for name in names]
    assert set(files) - set(without_strays(files)) == {Path(name) for name in strays}


@pytest.mark.parametrize(
    ("mode", "bits", "colour"),
    [
        *[("RGB", 8, True), ("RGBA", 8, True), ("P", 8, True)],
        *[("L", 8, False), ("LA", 8, False), ("1", 8, False), ("I;16", 16, False)],
    ],
)
def test_kinds_by_the_header(tmp_path: Path, mode: str, bits: int, colour: bool):
    image = Image.fromarray(np.full((8, 9), 3000, np.uint16)) if mode == "I;16" else Image.new(mode, (9, 8))
    image.save(tmp_path / "1.png")
    (tmp_path / "2.png").write_bytes(b"damaged")
    group = group_of("any", list_images(tmp_path))
    assert (group.bits, group.colour, group.size) == ({bits}, {colour}, (9, 8))
    assert group_of("any", [tmp_path / "2.png", tmp_path / "gone.png"]).bits == frozenset()
