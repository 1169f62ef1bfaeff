"""A small file of every kind that the program reads, and the reader of each, as the commands call it."""

import csv
import json
import tarfile
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import av
import cv2
import euroc_files
import hpatches_files
import kitti_files
import numpy as np
import posed_depth_files
import rgbd_files
import rgbd_layouts
import robotcar_files
import torch
import tum_mono_files
from textured_scenes import texture
from tiny_network import save_lightning, tiny_network

from sips_lit.baselines.learned import fill, read_weights
from sips_lit.baselines.precomputed import open_features
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.dataset_tools.check import check_sequence, check_video
from sips_lit.dataset_tools.unpack import unpack
from sips_lit.datasets.euroc import euroc
from sips_lit.datasets.hpatches import hpatches
from sips_lit.datasets.kitti import kitti
from sips_lit.datasets.nerfstudio import nerfstudio
from sips_lit.datasets.posed_depth import posed_depth
from sips_lit.datasets.replica import replica
from sips_lit.datasets.rgbd import rgbd
from sips_lit.datasets.robotcar import robotcar
from sips_lit.datasets.scannet import scannet
from sips_lit.datasets.seven_scenes import seven_scenes
from sips_lit.datasets.tum_mono import tum_mono
from sips_lit.describe.sift import RootSift
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import FeatureCache, image_key
from sips_lit.evaluate.method import Method
from sips_lit.frames.folder import folder as image_folder
from sips_lit.frames.image_size import image_size
from sips_lit.frames.video import find_videos, video
from sips_lit.frames.zip_images import ZipSequence
from sips_lit.inference.streams import open_stream
from sips_lit.pairs.build import measure, stored_index
from sips_lit.pairs.choice import read_pair_file
from sips_lit.pairs.index_run import write_table
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.types import ImageSequence

SIDE = (48, 64)  # rows and columns of images
POINTS = np.array([[5.25, 6.5], [20, 3], [11, 12.75], [30.5, 40]], np.float32)


@dataclass(frozen=True, slots=True)
class Kind:
    """``make`` fills an empty folder; ``files`` (a glob) are what is damaged; ``read`` reads the folder with a damaged file.

    ``read`` raises BadInputError where it can't, and AssertionError for values that nothing could use.
    """

    name: str
    make: Callable[[Path], object]
    files: str
    read: Callable[[Path, Path], object]


def plain(sequences: Iterable[ImageSequence]) -> None:
    """Reads all that sequences have; frames that can't be read are reported, numbers that can be are finite."""
    for sequence in sequences:
        report = check_sequence(sequence)
        assert all("\n" not in why for why in report.unreadable)
        for index in range(min(2, len(sequence))):
            camera, pose = sequence.camera(index), sequence.pose(index)
            assert camera is None or np.isfinite(camera.matrix).all()
            assert pose is None or np.isfinite(pose).all()
            try:
                depth = sequence.depth(index)
            except BadInputError:
                continue
            assert depth is None or not np.isinf(depth).any()


def image_kind(suffix: str, deep: bool = False, colour: bool = False) -> Kind:
    def make(folder: Path) -> None:
        for index in range(2):
            image = texture(*SIDE, index)
            image = image.astype(np.uint16) * 40 if deep else np.dstack([image, image // 2, image]) if colour else image
            assert cv2.imwrite(str(folder / f"{index}{suffix}"), image)

    def read(folder: Path, file: Path) -> None:
        plain(image_folder(folder))
        image_size(file)
        for frame in open_stream(folder, colour=True):
            assert frame.grey.dtype == np.uint8

    return Kind(f"image{'16' * deep}{suffix}", make, f"0{suffix}", read)


def data_set(name: str, loader: Callable[..., list[ImageSequence]], make: Callable, files: str, **options) -> Kind:
    return Kind(name, make, files, lambda folder, _: plain(loader(folder, **options)))


def video_kind(suffix: str, codec: str) -> Kind:
    def make(folder: Path) -> None:
        with av.open(str(folder / f"0.{suffix}"), "w") as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height, stream.gop_size = 64, 48, 4
            if codec != "libsvtav1":
                stream.bit_rate = 100_000
            stream.pix_fmt = {"mjpeg": "yuvj420p", "gif": "rgb8"}.get(codec, "yuv420p")
            for index in range(8):
                frame = av.VideoFrame.from_ndarray(texture(48, 96)[:, 2 * index : 2 * index + 64].copy(), "gray")
                container.mux(stream.encode(frame.reformat(format=stream.pix_fmt)))
            container.mux(stream.encode(None))

    def read(folder: Path, file: Path) -> None:
        report = check_video(file)
        assert all("\n" not in why for why in report.unreadable)
        plain(video(file, folder / "cache"))

    return Kind(f"video.{suffix}.{codec}", make, f"0.{suffix}", read)


def make_zip(packed: int) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        with zipfile.ZipFile(folder / "a.zip", "w", packed) as archive:
            for index in range(3):
                archive.writestr(f"{index}.pgm", cv2.imencode(".pgm", texture(24, 32, index))[1].tobytes())

    return make


def make_packed_depth(folder: Path) -> None:
    posed_depth_files.make_posed_depth(folder)
    depths = {f"{i:010d}": posed_depth_files.depth_of(i) for i in range(3)}
    np.savez_compressed(folder / "depth_48x64.npz", **depths)


def make_features(folder: Path) -> None:
    np.savez(folder / "1.npz", keypoints=POINTS, scores=POINTS[:, 0], descriptors=POINTS, image_size=[64, 48])
    np.savez_compressed(folder / "2.npz", kpts=POINTS, descs=np.tile(POINTS, 8))


def make_h5(folder: Path) -> None:
    import h5py

    with h5py.File(folder / "a.h5", "w") as file:
        for name in ("1.png", "2.png"):
            group = file.create_group(name)
            group["keypoints"], group["scores"] = POINTS.astype(np.float16), POINTS[:, 0].astype(np.float16)
            group.create_dataset("descriptors", data=np.tile(POINTS.T, (8, 1)), compression="gzip")
            group["image_size"] = np.array([64, 48])


def read_features(folder: Path, file: Path) -> None:
    files = open_features(file if file.suffix == ".h5" else folder)
    for name in ("1.png", "2.png"):
        if files.has(PurePosixPath(name)):
            saved = files.read(PurePosixPath(name))
            assert np.isfinite(saved.keypoints).all()
            assert saved.scores is None or np.isfinite(saved.scores).all()


def make_checkpoints(folder: Path) -> None:
    save_lightning(folder / "a.ckpt", tiny_network(), PointSelector())
    export_safetensors(tiny_network(), PointSelector(), folder / "a.safetensors")


def read_checkpoint(_: Path, file: Path) -> None:
    SipsDetector(*load_checkpoint(file)).detect(texture(*SIDE), 5)


def read_baseline(_: Path, file: Path) -> None:
    fill(torch.nn.Linear(3, 2), read_weights(file), file, "linear")


def make_pairs(folder: Path) -> None:
    with (folder / "pairs.csv").open("w", newline="") as file:
        csv.writer(file).writerows(
            [["sequence", "frame0", "frame1", "overlap"], ["images", 0, 1, 0.5], ["images", 1, 2, ""]]
        )
    (folder / "images").mkdir()
    for index in range(3):
        cv2.imwrite(str(folder / "images" / f"{index}.png"), texture(*SIDE, index))


def read_pairs(folder: Path, file: Path) -> None:
    for pair in read_pair_file(file, image_folder(folder / "images")):
        assert 0 <= pair.index0 < 3
        assert 0 <= pair.index1 < 3
        assert np.isnan(pair.overlap) or 0 <= pair.overlap <= 1


def make_caches(folder: Path) -> None:
    make_pairs(folder)
    (sequence,) = image_folder(folder / "images")
    measure(sequence, folder, OverlapParameters(), lambda: None)
    features(folder)
    rows = [{"recording": "a", "sequence": "a", "frames": 3, "points": 4, "reach": 1, "pairs": 2}]
    (folder / "summary-a-1of1.json").write_text(json.dumps(rows))


def features(folder: Path) -> object:
    image = texture(*SIDE)
    return FeatureCache(folder, Method("key", "Name", ShiTomasi(), RootSift(), {}), 20)(image_key(image), lambda: image)


def read_caches(folder: Path, file: Path) -> None:
    (sequence,) = image_folder(folder / "images")
    index = stored_index(sequence, folder, OverlapParameters())
    assert index is None or len(index) == 3
    features(folder)
    write_table(folder)


def make_frame_cache(folder: Path) -> None:
    video_kind("avi", "mjpeg").make(folder)
    plain(video(folder / "0.avi", folder / "cache"))


def make_list(folder: Path) -> None:
    make_frame_cache(folder)
    (folder / "list.txt").write_text("# videos\n0.avi\n\n*.avi\n")


def make_downloads(folder: Path) -> None:
    make_zip(zipfile.ZIP_DEFLATED)(folder)
    for name, kind in (("a.tar", ""), ("a.tar.gz", "gz")):
        with tarfile.open(folder / name, f"w:{kind}") as archive:
            archive.add(folder / "a.zip", "more/a.zip")


def read_download(folder: Path, file: Path) -> None:
    unpack(file, folder / "unpacked")


def make_nerfstudio(folder: Path) -> None:
    """With depth as arrays, and a lens."""
    table = rgbd_layouts.write_nerfstudio(folder, 2, {"k1": 0.05}) / "transforms.json"
    for file in (folder / "depths").iterdir():
        np.save(file.with_suffix(".npy"), cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float32))
    text = table.read_text()
    for number in (1, 2):
        text = text.replace(f"depths/frame_{number:05d}.png", f"depths/frame_{number:05d}.npy")
    table.write_text(text)


def make_replica(folder: Path) -> None:
    rgbd_layouts.write_replica(folder, 2, beside=True)


def make_legacy_weights(folder: Path) -> None:
    torch.save(torch.nn.Linear(3, 2).state_dict(), folder / "a.pth", _use_new_zipfile_serialization=False)


def make_tum_vi(folder: Path) -> None:
    euroc_files.as_tum_vi(euroc_files.make_euroc(folder / "room1", frames=2, columns=8))


def make_kitti(folder: Path) -> None:
    kitti_files.make_kitti(folder, cameras=(0, 1), frames=3)


KINDS = [
    *(image_kind(suffix) for suffix in (".png", ".jpg", ".jpe", ".jp2", ".bmp", ".tif", ".pgm", ".webp")),
    *(image_kind(suffix, colour=True) for suffix in (".ppm", ".pnm", ".jpeg", ".tiff")),
    *(image_kind(suffix, deep=True) for suffix in (".png", ".tif", ".pgm")),
    *(
        Kind(f"zip-{packed}", make_zip(packed), "a.zip", lambda folder, file: plain([ZipSequence(file)]))
        for packed in (0, 8)
    ),
    data_set("posed_depth", posed_depth, posed_depth_files.make_posed_depth, "*.[tn][xp][tz]"),
    data_set("posed_depth-packed", posed_depth, make_packed_depth, "*.npz"),
    data_set("kitti", kitti, make_kitti, "dataset/**/*.txt"),
    data_set("euroc", euroc, lambda folder: euroc_files.make_euroc(folder, frames=2), "mav0/*/*.*[vl]"),
    data_set("tum_vi", lambda folder: euroc(folder / "room1"), make_tum_vi, "room1/**/*.[yc]*[lv]"),
    data_set("rgbd", rgbd, lambda folder: rgbd_files.write_simple(folder, 2), "*.*"),
    data_set("rgbd-depth", rgbd, lambda folder: rgbd_files.write_simple(folder, 2), "depth/*0.png"),
    data_set(
        "tum_rgbd",
        rgbd,
        lambda f: rgbd_files.write_tum(f, rgbd_files.SIMPLE_K, size=(64, 48)),
        "*.txt",
        intrinsics=[60, 60, 32, 24],
    ),
    data_set("seven_scenes", seven_scenes, lambda folder: rgbd_layouts.write_seven_scenes(folder, 2), "*0000.*"),
    data_set("replica", replica, make_replica, "*.*"),
    data_set("scannet", scannet, lambda folder: rgbd_layouts.write_scannet(folder, 2), "*/*.txt"),
    data_set("nerfstudio", nerfstudio, make_nerfstudio, "*.json"),
    data_set("nerfstudio-depth", nerfstudio, make_nerfstudio, "depths/*1.npy"),
    data_set("tum_mono", tum_mono, tum_mono_files.write_sequence, "*.*", photometric=True, geometric=True),
    data_set("hpatches", hpatches, lambda folder: hpatches_files.write_sequence(folder), "v_made/H_1_[23]"),
    data_set("hpatches-image", hpatches, lambda folder: hpatches_files.write_sequence(folder), "v_made/[12].ppm"),
    data_set("robotcar", robotcar, robotcar_files.write_run, "*/*.timestamps", crop_bottom=20),
    Kind("features.npz", make_features, "*.npz", read_features),
    Kind("features.h5", make_h5, "*.h5", read_features),
    Kind("checkpoint", make_checkpoints, "a.[cs]*t*s*", read_checkpoint),
    Kind("ckpt", make_checkpoints, "a.ckpt", read_checkpoint),
    Kind(
        "weights",
        lambda folder: torch.save(torch.nn.Linear(3, 2).state_dict(), folder / "a.pth"),
        "*.pth",
        read_baseline,
    ),
    Kind("weights-legacy", make_legacy_weights, "*.pth", read_baseline),
    Kind("pairs.csv", make_pairs, "*.csv", read_pairs),
    Kind("caches", make_caches, "*.*[nz]", read_caches),
    Kind("features-cache", make_caches, "key-*/*.npz", read_caches),
    Kind("frame-cache", make_frame_cache, "cache/*/*", lambda f, _: plain(video(f / "0.avi", f / "cache"))),
    Kind("video-list", make_list, "list.txt", lambda f, file: [find_videos(file), plain(video(file, f / "cache"))]),
    *(
        video_kind(*pair)
        for pair in (
            ("mp4", "libx264"),
            ("mp4", "libsvtav1"),
            ("mov", "libx265"),
            ("m4v", "mpeg4"),
            ("avi", "mjpeg"),
            ("webm", "libvpx"),
            ("mpg", "mpeg2video"),
            ("m2v", "mpeg2video"),
            ("vob", "mpeg1video"),
            ("mkv", "mpeg4"),
            ("ts", "libx264"),
            ("m2ts", "libx264"),
            ("wmv", "wmv2"),
            ("flv", "flv"),
            ("3gp", "mpeg4"),
            ("ogv", "libvpx"),
            ("mxf", "mpeg2video"),
            ("gif", "gif"),
            ("ivf", "libvpx-vp9"),
            ("y4m", "wrapped_avframe"),
            ("mjpeg", "mjpeg"),
            ("h264", "libx264"),
            ("hevc", "libx265"),
        )
    ),
    Kind("download", make_downloads, "a.*", read_download),
]
