from pathlib import Path

import cv2
import numpy as np
import pytest
from euroc_files import make_euroc
from image_files import write_images
from kitti_files import make_kitti
from own_dataset import write_walk
from rgbd_files import matrix, write_simple, write_tum
from rgbd_layouts import write_nerfstudio, write_replica, write_scannet, write_seven_scenes
from robotcar_files import write_run
from textured_scenes import flight

from sips_lit.dataset_tools.check import check_sequence
from sips_lit.dataset_tools.recognise import recognise
from sips_lit.datasets.tum_rgbd import CALIBRATIONS
from sips_lit.errors import BadInputError, InputWarning

IMAGE = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()
LAYOUTS = {
    "euroc": ["mav0/cam0/sensor.yaml", "mav0/cam0/data/1.png"],
    "kitti": ["dataset/sequences/00/image_0/000000.png", "dataset/sequences/00/calib.txt"],
    "posed_depth": ["0000.jpg", "poses.txt", "cam.txt", "depth_128x416.npz"],
    "rgbd": ["rgb.txt", "depth.txt", "groundtruth.txt", "rgb/1.png", "depth/1.png"],
    "tum_mono": ["sequence_01/images.zip", "sequence_01/camera.txt", "sequence_01/times.txt"],
    "robotcar": ["2014-05-06-12-54-54/stereo/centre/1399381445587559.png"],
    "hpatches": ["v_bark/1.ppm", "v_bark/H_1_2"],
    "video": ["a.mp4"],
    "folder": ["a/1.png", "a/2.png"],
}


def lay_out(root: Path, files: list[str]) -> Path:
    for name in files:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(IMAGE if name.endswith((".png", ".jpg")) else b"x")
    return root


@pytest.mark.parametrize("kind", LAYOUTS)
def test_each_layout_is_known_by_its_files(tmp_path, kind):
    found = recognise(lay_out(tmp_path / "some", LAYOUTS[kind]))
    assert [d.spec.kind for d in found] == [kind]


def test_the_data_sets_of_a_folder_of_data_sets(tmp_path):
    for kind in ("euroc", "hpatches", "rgbd", "video"):
        lay_out(tmp_path / kind, LAYOUTS[kind])
    assert {d.path.name: d.spec.kind for d in recognise(tmp_path)} == {
        k: k for k in ("euroc", "hpatches", "rgbd", "video")
    }


def test_rgbd_as_plain_folders(tmp_path):
    root = lay_out(tmp_path, ["color/1.png", "depth/1.png", "poses.txt", "cam.json"])
    assert [d.spec.kind for d in recognise(root)] == ["rgbd"]


HALVES = {
    "euroc": [["mav0/cam1/data/1.png", "mav0/cam1/data/2.png"], ["mav0/cam0/data.csv", "mav0/cam0/data/1.png"]],
    "kitti": [
        ["sequences/00/calib.txt", "sequences/00/times.txt"],
        ["dataset/sequences/00/image_1/000000.png"],
        ["poses/00.txt"],
        ["image_0/000000.png", "image_1/000000.png", "times.txt"],
    ],
    "posed_depth": [["1.png", "2.png", "poses.txt", "cam.txt"], ["1.png", "2.png", "cam.txt", "depth_1x1.npz"]],
    "rgbd": [
        ["color/1.png", "color/2.png", "poses.txt", "cam.json"],
        ["depth/1.png", "depth/2.png", "cam.json"],
        ["rgb/1.png", "rgb/2.png", "rgb.txt", "groundtruth.txt"],
    ],
    "tum_mono": [["vignette.png", "times.txt", "pcalib.txt"], ["images.zip", "times.txt"]],
    "robotcar": [["2014-05-06-12-54-54/stereo.timestamps"]],
    "hpatches": [["v_bark/1.ppm", "v_bark/H_1_6"], ["v_bark/1.ppm"], ["v_bark/ref.png", "v_bark/e1.png"]],
}


@pytest.mark.parametrize(("kind", "files"), [(kind, half) for kind, halves in HALVES.items() for half in halves])
def test_half_of_a_data_set_is_known_for_what_it_is(tmp_path, kind, files):
    (dataset,) = recognise(lay_out(tmp_path / "some", files))
    assert dataset.spec.kind == kind
    with pytest.raises(BadInputError):  # and its loader says what is missing
        dataset.sequences()


LAYERED = sorted(set(LAYOUTS) - {"video", "folder"})
STRAYS = {
    "pictures": ["overview.png", "map.jpg"],
    "a video": ["preview.mp4"],
    "hidden folders": [".ipynb_checkpoints/1.png", ".ipynb_checkpoints/2.png", ".trash/mav0/cam0/data.csv"],
}


@pytest.mark.parametrize("strays", STRAYS)
@pytest.mark.parametrize("kind", LAYERED)
def test_strays_in_its_root_do_not_make_it_another(tmp_path, kind, strays):
    clean = recognise(lay_out(tmp_path / "some", LAYOUTS[kind]))
    assert recognise(lay_out(tmp_path / "some", STRAYS[strays])) == clean


@pytest.mark.parametrize("kind", ["video", "folder"])
def test_hidden_files_and_folders_are_no_data_set(tmp_path, kind):
    root = lay_out(tmp_path / "some", LAYOUTS[kind])
    clean = recognise(root)
    assert recognise(lay_out(root, [".a.mp4", ".1.png", *STRAYS["hidden folders"]])) == clean


def test_images_beside_folders_of_images_are_one_data_set(tmp_path):
    root = lay_out(tmp_path / "some", ["1.png", "2.png", "thumbnails/1.png", "thumbnails/2.png"])
    assert [(d.spec.kind, d.path) for d in recognise(root)] == [("folder", root)]


@pytest.mark.parametrize("kind", ["euroc", "rgbd", "robotcar", "folder"])
def test_loaders_pass_over_hidden_folders(tmp_path, kind):
    makers = {
        "euroc": lambda place: make_euroc(place),
        "rgbd": lambda place: write_simple(place, 2),
        "robotcar": lambda place: write_run(place),
        "folder": lambda place: lay_out(place, ["1.png", "2.png"]),
    }
    for name in ("a", ".b"):
        makers[kind](tmp_path / "some" / name)
    (dataset,) = recognise(tmp_path / "some")
    assert dataset.spec.kind == kind
    assert len(dataset.sequences()) == 1


def test_a_data_set_of_another_package(tmp_path, installed):
    root = tmp_path / "walks"
    write_walk(root / "one", flight(3).frames)
    write_walk(root / "two", flight(4).frames)
    lay_out(root, ["overview.png"])
    with pytest.raises(BadInputError, match="known here"):
        recognise(root / "one")
    installed()
    (dataset,) = recognise(root)
    assert (dataset.spec.title, dataset.sign, len(dataset.parts)) == ("Walks", "one/walk.npz and 1 more", 2)
    assert [len(sequence) for sequence in dataset.sequences()] == [3, 4]
    assert [sequence.name for sequence in dataset.sequences(reverse=True)] == ["two", "one"]
    with pytest.raises(BadInputError, match="the folder of one of Walks, EuRoC"):
        recognise(tmp_path / "gone")


def test_what_the_loader_must_be_told(tmp_path):
    colour = make_kitti(tmp_path / "kitti", cameras=(2, 3))
    (dataset,) = recognise(colour)
    assert dataset.options == {"colour": True}
    assert len(dataset.sequences()) == 1
    assert recognise(make_kitti(tmp_path / "both"))[0].options == {}
    write_run(tmp_path / "robotcar", camera="mono_rear")
    (dataset,) = recognise(tmp_path / "robotcar")
    assert dataset.options == {"camera": "mono_rear"}
    assert len(dataset.sequences()) == 1


def test_archives_are_to_be_unpacked(tmp_path):
    with pytest.raises(BadInputError, match=r"unpack MH_01\.zip first"):
        recognise(lay_out(tmp_path, ["MH_01.zip", "readme.txt"]))


@pytest.mark.parametrize("files", [[], ["notes.txt"], ["a/b/notes.txt"]])
def test_nothing_known_says_what_is_there(tmp_path, files):
    lay_out(tmp_path, files)
    with pytest.raises(BadInputError, match="holds no data set that is known here"):
        recognise(tmp_path)


def test_a_path_that_does_not_exist(tmp_path):
    with pytest.raises(BadInputError, match="does not exist"):
        recognise(tmp_path / "nowhere")


@pytest.mark.shared_data
def test_every_folder_of_the_shared_data(shared_data):
    found = {d.path.name: d.spec.kind for d in recognise(shared_data)}
    assert found == {
        "boofcv": "video",
        "boofcv_driving_snow": "folder",
        "boofcv_mvs": "video",
        "euroc_v1_01_excerpt": "euroc",
        "free_clips": "video",
        "hpatches": "hpatches",
        "kitti_odometry": "kitti",
        "kitti_raw_0001_lowres": "posed_depth",
        "rgbd_desk": "rgbd",
        "odm_caliterra_stills": "folder",
        "tum_fr1_xyz": "folder",
        "tum_fr2_desk": "folder",
        "udacity_lanes": "video",
        "video_clips": "video",
        "visp_cube": "folder",
    }


def used(root: Path) -> list[tuple[str, str, dict]]:
    """What is recommended; each must load, and has no depth map or mask among its frames."""
    found = recognise(root)
    for dataset in found:
        for sequence in dataset.sequences():
            for i in range(len(sequence)):
                assert sequence.frame(i).std() > 10
                assert "depth" not in str(sequence.files[i].relative_to(root))
                assert "mask" not in str(sequence.files[i].relative_to(root))
    return [(d.spec.kind, str(d.path.relative_to(root)), dict(d.options)) for d in found]


def test_depth_maps_and_masks_are_not_recommended(tmp_path):
    for name, kind in (("rgb", "colour"), ("depth", "depth"), ("mask", "mask")):
        write_images(tmp_path / "split" / name, "{:04d}.png", kind)
    with pytest.warns(InputWarning, match="6 depth .16-bit grey., 6 mask .8-bit grey. are taken for"):
        assert used(tmp_path / "split") == [("folder", "rgb", {})]
    write_images(tmp_path / "flat", "frame{:04d}.jpg", "colour")
    write_images(tmp_path / "flat", "depth{:04d}.png", "depth")
    assert used(tmp_path / "flat") == [("folder", ".", {"names": "frame*.jpg"})]
    for name, size in (("images", (96, 128)), ("images_2", (48, 64))):
        write_images(tmp_path / "sizes" / name, "{:04d}.png", "colour", size=size)
    assert used(tmp_path / "sizes") == [("folder", "images", {})]
    for alone in (tmp_path / "split" / "depth", write_images(tmp_path / "only" / "depth", "{}.png", "depth").parent):
        with pytest.raises(BadInputError, match="holds no data set that is known here"):
            recognise(alone)
    assert used(write_images(tmp_path / "thermal", "{:04d}.png", "depth")) == [("folder", ".", {})]


@pytest.mark.parametrize("stray", ["preview.png", ".ipynb_checkpoints/1.png", "__MACOSX/1.png", "@eaDir/1.png"])
def test_strays_beside_folders_of_frames_and_of_videos(tmp_path, stray):
    for name in ("a", "b"):
        write_images(tmp_path / "frames" / name, "{:04d}.png", "colour")
        lay_out(tmp_path / "clips" / name, ["1.mp4"])
    lay_out(tmp_path / "frames", [stray])
    lay_out(tmp_path / "clips", [stray])
    (dataset,) = recognise(tmp_path / "frames")
    assert (dataset.path, [len(s) for s in dataset.sequences()]) == (tmp_path / "frames", [6, 6])
    assert [(d.spec.kind, d.path.name) for d in recognise(tmp_path / "clips")] == [("video", "a"), ("video", "b")]


def test_a_stray_video_does_not_replace_frames_nor_previews_videos(tmp_path):
    write_images(lay_out(tmp_path / "frames", ["preview.mp4"]), "{:04d}.png", "colour")
    assert [d.spec.kind for d in recognise(tmp_path / "frames")] == ["video", "folder"]
    lay_out(tmp_path / "clips", ["a.mp4", "b.mp4", "a.jpg", "b.jpg", "more/c.mp4"])
    assert [(d.spec.kind, d.path.name) for d in recognise(tmp_path / "clips")] == [
        ("video", "clips"),
        ("video", "more"),
    ]


WITH_DEPTH = {
    "seven_scenes": write_seven_scenes,
    "replica": write_replica,
    "scannet": write_scannet,
    "nerfstudio": write_nerfstudio,
    "rgbd": write_simple,
}


@pytest.mark.parametrize("kind", WITH_DEPTH)
@pytest.mark.parametrize("scenes", [(".",), ("one", "two")])
def test_layouts_with_colour_and_depth_are_known_and_load(tmp_path, kind, scenes):
    for scene in scenes:
        WITH_DEPTH[kind](tmp_path / "some" / scene, 2)
    lay_out(tmp_path / "some", ["preview.png", ".ipynb_checkpoints/1.png", "__MACOSX/color/1.png"])
    (dataset,) = recognise(tmp_path / "some")
    assert (dataset.spec.kind, dataset.path, dataset.options) == (kind, tmp_path / "some", {})
    sequences = dataset.sequences()
    assert [len(sequence) for sequence in sequences] == [2] * len(scenes)
    for sequence in sequences:
        assert set(sequence_parts(sequence)) >= {"intrinsics", "poses", "depth"}


def sequence_parts(sequence) -> dict[str, int]:
    return check_sequence(sequence).parts


@pytest.mark.parametrize("gone", [[], ["rgb.txt", "depth.txt"], ["rgb.txt", "depth.txt", "groundtruth.txt"]])
def test_tum_rgbd_with_and_without_its_lists(tmp_path, gone):
    root = write_tum(tmp_path / "rgbd_dataset_freiburg3_made", matrix(*CALIBRATIONS[3][0]), count=2)
    for name in gone:
        (root / name).unlink()
    (dataset,) = recognise(root)
    (sequence,) = dataset.sequences()
    assert {file.parent.name for file in sequence.files} == {"rgb"}
    if len(gone) == 3:
        assert (dataset.spec.kind, dataset.path) == ("folder", root / "rgb")
    else:
        assert dataset.spec.kind == "rgbd"
        assert sequence_parts(sequence)["poses"] == sequence_parts(sequence)["depth"] == 2


def test_colour_and_depth_without_a_table_are_the_colour(tmp_path):
    for name, kind in (("color", "colour"), ("depth", "depth")):
        write_images(tmp_path / name, "{:04d}.png", kind)
    (dataset,) = recognise(tmp_path)
    assert (dataset.spec.kind, dataset.path) == ("folder", tmp_path / "color")
    assert len(dataset.sequences()[0]) == 6
