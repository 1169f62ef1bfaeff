import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import tum_mono_files
from kitti_files import make_kitti
from textured_scenes import ArraySequence, flight

from sips_lit.dataset_tools.check import DataSetReport, check, check_sequence, check_video, frame_rate, path_of, remarks
from sips_lit.dataset_tools.recognise import DataSet, recognise
from sips_lit.datasets import kitti, rgbd
from sips_lit.errors import BadInputError
from sips_lit.frames.video import video
from sips_lit.types import Camera


class Posed(ArraySequence):
    """Ten frames a second, 0.3 m and 10 degrees a step; frame 2 is damaged."""

    step = 0.3

    def frame(self, index):
        if index == 2:
            raise BadInputError("frame 2 is damaged")
        return super().frame(index)

    def camera(self, index):
        return Camera(np.eye(3), (160, 120))

    def pose(self, index):
        T = np.eye(4)
        angle = np.radians(10 * index if self.step > 0.1 else 0.1)
        T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        T[0, 3] = self.step * index
        return T

    def time(self, index):
        return 5 + 0.1 * index


def test_parts_path_rate_and_damage_are_counted():
    report = check_sequence(Posed(flight(4).frames))
    assert report.frames == 4
    assert report.unreadable == ["frame 2 is damaged"]
    assert report.parts == {"intrinsics": 3, "poses": 3, "times": 3}
    assert report.rate == pytest.approx(10)
    assert report.path_metres == pytest.approx(0.9)
    assert report.turn_degrees == pytest.approx(30)


class Named(ArraySequence):
    """Frames with the names that a test gives them."""

    names: tuple[str, ...] = ()

    def frame_name(self, index):
        return self.names[index]


@pytest.mark.parametrize(
    ("names", "rate", "steps_back"),
    [
        (("cam0_1548266470.0", "cam0_1548266470.1", "cam0_1548266470.05"), None, 1),
        (("1548266470.0", "1548266470.1", "1548266470.2"), 10, 0),
        (("1548266470_033333333", "1548266470_066666666", "1548266470_099999999"), None, 0),
        (("0000000000", "0000000001", "0000000002"), None, 0),
    ],
)
def test_times_in_names(names, rate, steps_back):
    sequence = Named(flight(3).frames)
    sequence.names = names
    report = check_sequence(sequence)
    assert report.steps_back == steps_back
    assert (None if report.steps_back else report.rate) == (rate if rate is None else pytest.approx(rate, rel=1e-3))
    remark = f"time steps back {steps_back} times"
    assert any(remark in said for said in remarks(DataSetReport(DataSet(rgbd.SPEC, Path(), ""), [report]))) == bool(
        steps_back
    )


@pytest.mark.parametrize("level", [0, 128, 255])
def test_images_without_contrast(level):
    flat = check_sequence(ArraySequence([np.full((48, 64), level, np.uint8)] * 3))
    seen = check_sequence(ArraySequence(flight(3).frames))
    said = remarks(DataSetReport(DataSet(rgbd.SPEC, Path(), ""), [flat, seen]))
    assert sum("images without contrast" in remark for remark in said) == 1


def test_how_much_of_the_depth_is_known():
    class Sparse(ArraySequence):
        def depth(self, index):
            return np.where(np.arange(100).reshape(10, 10) < 30, 2.0, np.nan)

    report = check_sequence(Sparse(flight(2).frames))
    assert report.depth_known == pytest.approx([0.3, 0.3])
    dataset = DataSet(rgbd.SPEC, Path(), "a test")
    assert any("30% of the pixels" in remark for remark in remarks(DataSetReport(dataset, [report])))


def test_every_frame_is_told():
    told = []
    check_sequence(Posed(flight(4).frames), told.append)
    assert sum(told) == 4


def test_without_poses_or_times():
    plain = ArraySequence(flight(3).frames)
    assert path_of(plain) == (None, None)
    assert frame_rate(plain) is None


def write_images(folder, count=3, names=None):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"{names[i] if names else i}.png"), np.full((20, 30), 40 * i, np.uint8))
    return folder


def test_names_that_are_times_give_the_rate(tmp_path):
    names = ["1311868169.163498", "1311868169.263274", "1311868169.363470"]
    (dataset,) = recognise(write_images(tmp_path, names=names))
    (sequence,) = check(dataset).sequences
    assert sequence.rate == pytest.approx(10, rel=0.01)


def test_a_truncated_image_is_named(tmp_path):
    write_images(tmp_path)
    (tmp_path / "1.png").write_bytes((tmp_path / "1.png").read_bytes()[:40])
    (dataset,) = recognise(tmp_path)
    report = check(dataset)
    assert not report.whole
    assert any("1.png" in remark and "truncated" in remark for remark in remarks(report))


def test_a_loader_that_refuses_is_the_problem(tmp_path):
    report = check(DataSet(kitti.SPEC, tmp_path / "nothing", "a test"))
    assert len(report.problems) == 1
    assert not report.whole
    assert remarks(report)[0] == report.problems[0]


def write_video(path, frames=12):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 20, (64, 48))
    for i in range(frames):
        writer.write(np.full((48, 64, 3), 10 * i, np.uint8))
    writer.release()
    return path


def test_a_video_is_decoded_to_its_end(tmp_path):
    report = check_video(write_video(tmp_path / "a.mp4"))
    assert (report.frames, dict(report.sizes), report.unreadable) == (12, {(64, 48): 12}, [])
    assert report.rate == pytest.approx(20)


def test_a_video_that_changes_its_shape_is_told_as_its_loader_says(tmp_path):
    path = tmp_path / "turned.mjpeg"
    images = [np.full(size, 90, np.uint8) for size in ((48, 64), (24, 32), (64, 48))]
    path.write_bytes(b"".join(cv2.imencode(".jpg", image)[1].tobytes() for image in images for _ in range(2)))
    (problem,) = check_video(path).unreadable
    assert problem == f"{path}, frame 4, is 48x64, of another shape than the frames before: split the video there"
    with pytest.raises(BadInputError, match=re.escape(problem)):
        video(path, tmp_path / "cache")


def test_a_file_that_is_no_video(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"not a video")
    (dataset,) = recognise(tmp_path)
    report = check(dataset)
    assert not report.whole
    assert "is no video that can be read" in remarks(report)[0]


def test_what_is_lacking_is_told():
    class Half(Posed):
        def frame(self, index):
            return ArraySequence.frame(self, index)

        def pose(self, index):
            return super().pose(index) if index < 2 else None

    dataset = DataSet(kitti.SPEC, Path(), "a test")
    said = remarks(DataSetReport(dataset, [check_sequence(Half(flight(4).frames))]))
    assert any("no right images" in remark for remark in said)
    assert any("2 frames without poses" in remark for remark in said)


def test_a_camera_that_stands_still_is_told():
    class Still(Posed):
        step = 0.001

        def frame(self, index):
            return ArraySequence.frame(self, index)

    dataset = DataSet(rgbd.SPEC, Path(), "a test")
    said = remarks(DataSetReport(dataset, [check_sequence(Still(flight(4).frames))]))
    assert any("stands still" in remark for remark in said)


def test_every_part_that_is_not_whole_is_told_and_the_others_are_opened(tmp_path):
    dataset = make_kitti(tmp_path, names=("00", "01", "02"))
    (dataset / "sequences/00/calib.txt").unlink()
    (dataset / "poses/02.txt").write_text("1 2 3\n")
    report = check(recognise(dataset)[0])
    assert [sequence.name for sequence in report.sequences] == ["kitti_01"]
    assert [("00/calib.txt" in p, "poses/02.txt" in p) for p in report.problems] == [(True, False), (False, True)]


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("camera.txt", "0.5 0.6 x 0.5 0.9\n160 128\ncrop\n80 60\n", "line 1 of"),
        ("camera.txt", None, "there is no"),
        ("pcalib.txt", "1 2 3\n", "256"),
        ("vignette.png", None, "there is no"),
    ],
)
def test_the_calibration_of_tum_mono_is_checked(tmp_path, file, text, said):
    folder = tum_mono_files.write_sequence(tmp_path / "sequence_01")
    assert check(recognise(folder)[0]).problems == []
    (folder / file).unlink()
    if text is not None:
        (folder / file).write_text(text)
    report = check(recognise(folder)[0])
    (problem,) = report.problems
    assert said in problem
    assert file in problem
    assert report.sequences[0].frames == 4  # its images open all the same


def test_links_that_lead_out_are_told(tmp_path):
    folder = write_images(tmp_path / "set")
    write_images(tmp_path / "other")
    (folder / "1.png").unlink()
    (folder / "1.png").symlink_to(tmp_path / "other" / "1.png")
    (folder / "inside.txt").symlink_to(folder / "0.png")
    (folder / "circle").symlink_to(folder / "circle")
    report = check(recognise(folder)[0])
    assert report.whole
    assert report.links == [folder / "1.png", folder / "circle"]
    assert remarks(report)[0].startswith("2 links lead out of the folder, or nowhere")


def test_a_link_that_leads_nowhere_is_an_image_that_does_not_open(tmp_path):
    folder = write_images(tmp_path)
    (folder / "1.png").unlink()
    (folder / "1.png").symlink_to(tmp_path / "nothing.png")
    report = check(recognise(folder)[0])
    assert report.sequences[0].frames == 3
    assert not report.whole
    assert any("cannot read the image" in remark and "1.png" in remark for remark in remarks(report))


@pytest.mark.parametrize("ordered", [True, False])
def test_different_sizes_are_told_where_the_order_is_that_of_time(ordered):
    sequence = ArraySequence([np.zeros((20, 30), np.uint8), np.zeros((40, 30), np.uint8)])
    sequence.temporal = ordered
    said = remarks(DataSetReport(DataSet(rgbd.SPEC, Path(), "a test"), [check_sequence(sequence)]))
    assert any("images of 2 different sizes" in remark for remark in said) == ordered


@pytest.mark.shared_data
def test_the_drone_of_the_excerpt_stands_still(shared_data):
    (dataset,) = recognise(shared_data / "euroc_v1_01_excerpt")
    report = check(dataset)
    assert report.whole
    assert any("stands still" in remark for remark in remarks(report))
