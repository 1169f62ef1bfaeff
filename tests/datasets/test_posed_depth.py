import math
import pickle
import re
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from overlap_rows import all_overlap
from posed_depth_files import POSES, depth_of, make_posed_depth
from textured_scenes import texture

from sips_lit.datasets.posed_depth import posed_depth
from sips_lit.errors import BadInputError
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.frames.source import Source
from sips_lit.geometry.projection import transfer
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.choice import ListedPair
from sips_lit.pairs.sampler import SourceSampler
from sips_lit.train.dataset import TrainingPairs


def test_frames_camera_poses_and_depth(tmp_path: Path):
    (sequence,) = posed_depth(make_posed_depth(tmp_path / "drive"))
    assert (len(sequence), sequence.name, sequence.frame_name(1)) == (3, "drive", "0000000001")
    np.testing.assert_array_equal(sequence.frame(2), texture(48, 64, 2))
    assert sequence.camera(0).size == (64, 48)
    assert sequence.camera(0).matrix[0].tolist() == [50, 0, 31.5]
    assert sequence.pose(2)[:3, 3].tolist() == [1, 0, 2]
    depth = sequence.depth(1)
    assert depth.dtype == np.float32
    assert np.isnan(depth[::2]).all()
    np.testing.assert_array_equal(depth[1::2], 11)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(sequence)).depth(1), depth)


def test_what_is_no_depth_is_unknown(tmp_path: Path):
    folder = make_posed_depth(tmp_path)
    depth = np.full((48, 64), 5.0)
    depth[0, :4] = (0, -1, np.inf, np.nan)
    np.savez(folder / "depth_48x64.npz", **{f"{i:010d}": depth for i in range(3)})
    (sequence,) = posed_depth(folder)
    assert np.isnan(sequence.depth(0)[0, :4]).all()
    assert np.isfinite(sequence.depth(0)).sum() == 48 * 64 - 4


def test_depth_of_another_size(tmp_path: Path):
    folder = make_posed_depth(tmp_path)
    np.savez(folder / "depth_48x64.npz", **{f"{i:010d}": np.ones((24, 32)) for i in range(3)})
    with pytest.raises(BadInputError, match=r"0000000001 of .*shape \(24, 32\).*48 rows of 64 pixels"):
        posed_depth(folder)[0].depth(1)


def save_some(folder: Path) -> None:
    np.savez(folder / "depth_48x64.npz", **{f"{i:010d}": depth_of(i) for i in range(2)})


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: (f / "poses.txt").unlink(), r"no .*poses\.txt: .*; the layout is images"),
        (lambda f: (f / "cam.txt").unlink(), r"no .*cam\.txt: .*; the layout is images"),
        (lambda f: (f / "depth_48x64.npz").unlink(), r"no depth_\*\.npz in .*; the layout is images"),
        (lambda f: (f / "depth_2.npz").touch(), "keep one archive"),
        (lambda f: (f / "depth_48x64.npz").write_bytes(b"PK not a zip"), "is not an npz archive, or is truncated"),
        (save_some, "lacks the depth of 1 images, the first is 0000000002"),
        (lambda f: (f / "poses.txt").write_text("\n".join(POSES[:2])), "has 2 poses for 3 images"),
        (lambda f: (f / "poses.txt").write_text("\n".join(POSES).replace("0.5", "nan")), r"line 2 of .*poses\.txt"),
        (lambda f: (f / "cam.txt").write_text("50 0 31.5\n0 50 23.5\n"), r"cam\.txt has no camera matrix"),
        (lambda f: (f / "cam.txt").write_text("0 0 31.5\n0 50 23.5\n0 0 1\n"), r"cam\.txt has no camera matrix"),
        (lambda f: (f / "cam.txt").write_text("inf 0 31.5\n0 50 23.5\n0 0 1\n"), r"line 1 of .*cam\.txt has 'inf'"),
        (
            lambda f: (f / "cam.txt").write_text("50 0 1e99\n0 50 23.5\n0 0 1\n"),
            r"cam\.txt has focal .* of images of 64x48",
        ),
        (lambda f: [p.unlink() for p in f.glob("*.png")], "with two images or more: .*has cam.txt, depth"),
    ],
)
def test_half_a_folder(tmp_path: Path, damage, message: str):
    folder = make_posed_depth(tmp_path)
    damage(folder)
    with pytest.raises(BadInputError, match=message) as caught:
        posed_depth(folder)
    assert "\n" not in str(caught.value)


def test_a_truncated_archive(tmp_path: Path):
    folder = make_posed_depth(tmp_path)
    (sequence,) = posed_depth(folder)
    content = (folder / "depth_48x64.npz").read_bytes()
    (folder / "depth_48x64.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(BadInputError, match=r"0000000000\.npy in .*depth_48x64\.npz is damaged"):
        sequence.depth(0)


@pytest.fixture
def with_damaged_depth(tmp_path: Path) -> Path:
    """Three frames, of which the depth of the second is packed into bytes that zlib can't unpack."""
    folder = make_posed_depth(tmp_path / "drive")
    np.savez_compressed(folder / "depth_48x64.npz", **{f"{i:010d}": depth_of(i) for i in range(3)})
    with zipfile.ZipFile(folder / "depth_48x64.npz") as archive:
        member = archive.infolist()[1]
    content = bytearray((folder / "depth_48x64.npz").read_bytes())
    start = member.header_offset + 30 + len(member.filename)
    content[start : start + member.compress_size] = b"\xff" * member.compress_size
    (folder / "depth_48x64.npz").write_bytes(content)
    return folder


def test_damaged_depth_leaves_the_pair_out_of_training(with_damaged_depth: Path):
    sources = [Source(posed_depth(with_damaged_depth))]
    pairs = TrainingPairs(sources, SourceSampler(sources, [all_overlap(3)], 0.5, 1), PoseDepthInliers(), None, 20)
    drawn = [pairs[index] for index in range(len(pairs))]
    assert {item.pair.name for item in drawn} <= {"drive:0-2", "drive:2-0"}
    skipped = [why for item in drawn for why in item.skipped]
    assert len(skipped) > 5
    assert all(re.fullmatch(r"0000000001\.npy in .*depth_48x64\.npz is damaged: .*", why) for why in skipped)


def test_damaged_depth_is_refused_by_an_evaluation(with_damaged_depth: Path):
    listed = [ListedPair(0, 0, 2, math.nan), ListedPair(0, 0, 1, math.nan)]
    pairs = PairSet([Source(posed_depth(with_damaged_depth))], listed, PoseDepthInliers())
    with pytest.raises(BadInputError, match=r"0000000001\.npy in .*depth_48x64\.npz is damaged"):
        pairs.verifiable()


def test_fingerprint(tmp_path: Path):
    folder = make_posed_depth(tmp_path)
    prints = [posed_depth(folder)[0].fingerprint, posed_depth(folder)[0].fingerprint]
    for file in ("poses.txt", "cam.txt", "0000000001.png"):
        with (folder / file).open("ab") as stream:
            stream.write(b"\n")
        prints.append(posed_depth(folder)[0].fingerprint)
    assert len(set(prints)) == 4


@pytest.mark.shared_data
def test_pose_and_depth_predict_the_next_picture(shared_data):
    (sequence,) = posed_depth(shared_data / "kitti_raw_0001_lowres")
    camera = sequence.camera(0)
    errors = []
    for index in range(0, 100, 20):
        depth = sequence.depth(index)
        row, column = np.nonzero(np.isfinite(depth))
        xy = np.column_stack([column, row]).astype(np.float64)
        T = np.linalg.inv(sequence.pose(index + 2)) @ sequence.pose(index)
        grey = sequence.frame(index)[row, column].astype(np.float64)
        errors.append([])
        for motion in (T, np.eye(4), np.linalg.inv(T)):
            moved, _ = transfer(xy, depth[row, column], camera, camera, motion)
            x, y = (axis[:, None] for axis in moved.astype(np.float32).T)
            seen = cv2.remap(sequence.frame(index + 2), x, y, cv2.INTER_LINEAR)[:, 0]
            inside = ((x > 1) & (y > 1) & (x < 414) & (y < 126))[:, 0]
            errors[-1].append(np.abs(seen - grey)[inside].mean())
    true, still, backwards = np.mean(errors, 0)
    assert true < 0.5 * still
    assert true < 0.5 * backwards
