"""Is a data set whole? Every file is opened; what is there and what is missing is counted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.dataset_tools.recognise import DataSet
from sips_lit.datasets.spec import Part
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.video import check_shape
from sips_lit.frames.video_file import VideoFile
from sips_lit.types import ImageSequence

STILL_METRES = 0.05  # a camera whose whole path is shorter stands still
STILL_DEGREES = 2.0
FLAT = 2.0  # grey levels: images that vary less (standard deviation) have no points to speak of
TIME_NAME = re.compile(r"\D*(?:\d{1,2}\D+)?([1-9]\d{8,9}(?:\.\d+)?)\D*")  # cam0_ and seconds since 1970


@dataclass(slots=True)
class SequenceReport:
    """What was found in one sequence: ``parts`` counts the frames that have each `Part`.

    ``temporal``: whether the frames are in the order of time; ``sizes`` (W, H) of the frames that open and how many have
    each; ``rate`` in frames per second, None if unknown; ``steps_back``: frames that are not later than the one before;
    ``notes`` of the sequence itself; ``unreadable``: one sentence for each file that does not open;
    ``path_metres`` and ``turn_degrees``: how far the camera moves and turns by its poses, None without; ``depth_known``:
    fraction of the pixels of each depth map that have a depth; ``contrast``: standard deviation of each frame, grey levels.
    """

    name: str
    frames: int = 0
    temporal: bool = True
    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)
    parts: Counter[Part] = field(default_factory=Counter)
    rate: float | None = None
    unreadable: list[str] = field(default_factory=list)
    steps_back: int = 0
    notes: list[str] = field(default_factory=list)
    path_metres: float | None = None
    turn_degrees: float | None = None
    depth_known: list[float] = field(default_factory=list)
    contrast: list[float] = field(default_factory=list)


@dataclass(slots=True)
class DataSetReport:
    """What was found in a data set; ``problems``: why its loader refuses it or a part of it, a sentence each.

    ``links`` are files and folders that lead out of it.
    """

    dataset: DataSet
    sequences: list[SequenceReport] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    links: list[Path] = field(default_factory=list)
    bytes: int = 0

    @property
    def whole(self) -> bool:
        """Whether everything opened."""
        return not self.problems and not any(s.unreadable for s in self.sequences)


def check(dataset: DataSet, advance: Callable[[int], object] = lambda frames: None) -> DataSetReport:
    """Opens every file of a data set; ``advance`` is called for each frame."""
    report = DataSetReport(dataset, links=links_out(dataset.path), bytes=size_on_disk(dataset.path))
    try:
        if dataset.spec.videos:
            report.sequences = [check_video(file, advance) for file in dataset.spec.videos(dataset.path)]
        else:
            sequences, report.problems = open_parts(dataset)
            report.sequences = [check_sequence(sequence, advance) for sequence in sequences]
    except BadInputError as error:
        report.problems.append(str(error))
    report.problems += switch_problems(dataset) if dataset.spec.switches else []
    return report


def open_parts(dataset: DataSet) -> tuple[list[ImageSequence], list[str]]:
    """The sequences of a data set; refused together, those of the parts that open, and why others don't."""
    try:
        return dataset.sequences(), []
    except BadInputError as error:
        opened: list[ImageSequence] = []
        problems: list[str] = []
        for part in dataset.parts:
            try:
                opened += dataset.sequences(part)
            except BadInputError as error_of_part:
                problems.append(str(error_of_part))
        return opened, problems or [str(error)]


def switch_problems(dataset: DataSet) -> list[str]:
    """What is missing or damaged that only a switch of the loader needs, such as a calibration."""
    problems = []
    for part in dataset.parts or (dataset.path,):
        for switch in dataset.spec.switches:
            try:
                dataset.sequences(part)
            except BadInputError:
                break  # that is reported already
            try:
                dataset.sequences(part, **{switch: True})
            except BadInputError as error:
                problems.append(f"{error} (only data.{switch}=true needs it)")
                break
    return problems


def check_sequence(sequence: ImageSequence, advance: Callable[[int], object] = lambda frames: None) -> SequenceReport:
    """Reads all frames, right images and depth maps of a sequence."""
    report = SequenceReport(sequence.name, len(sequence), sequence.temporal)
    for index in range(len(sequence)):
        try:
            frame = sequence.frame(index)
            report.sizes[frame.shape[1], frame.shape[0]] += 1
            report.contrast.append(float(frame.std()))
            known = {part: value for part, value in _parts(sequence, index).items() if value is not None}
            report.parts.update(known.keys())
            if "depth" in known:
                report.depth_known.append(float(np.isfinite(known["depth"]).mean()))
        except BadInputError as error:
            report.unreadable.append(str(error))
        advance(1)
    report.rate, report.steps_back = frame_rate(sequence), int((np.diff(times_of(sequence)) <= 0).sum())
    report.notes = sequence.notes()
    report.path_metres, report.turn_degrees = path_of(sequence)
    return report


def _parts(sequence: ImageSequence, index: int) -> dict[Part, Any]:
    return {
        "right images": sequence.right(index),
        "intrinsics": sequence.camera(index),
        "poses": sequence.pose(index),
        "depth": sequence.depth(index),
        "times": sequence.time(index),
        "homographies": sequence.homography(0, index),
    }


def frame_rate(sequence: ImageSequence) -> float | None:
    """Frames per second by the median time between frames; None where times are not known."""
    steps = np.diff(times_of(sequence))
    return None if not len(steps) or np.median(steps) <= 0 else float(1 / np.median(steps))


def times_of(sequence: ImageSequence) -> NDArray[np.float64]:
    """The times that are known of frames, in their order: the data set's, or file names that are seconds since 1970."""
    times = [t for t in map(sequence.time, range(len(sequence))) if t is not None]
    if not times:
        names = [TIME_NAME.fullmatch(sequence.frame_name(i)) for i in range(len(sequence))]
        times = [float(name[1]) for name in names if name] if all(names) else []
    return np.array(times, np.float64)


def path_of(sequence: ImageSequence) -> tuple[float | None, float | None]:
    """Greatest distance (metres) and angle (degrees) of any pose from the first one; None without poses."""
    poses = np.array([pose for pose in map(sequence.pose, range(len(sequence))) if pose is not None])
    if len(poses) < 2:
        return None, None
    moves = np.linalg.inv(poses[0]) @ poses
    cosine = (np.trace(moves[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return float(np.linalg.norm(moves[:, :3, 3], axis=1).max()), float(angle.max())


def check_video(file: Path, advance: Callable[[int], object] = lambda frames: None) -> SequenceReport:
    """Decodes a whole video, keeping nothing."""
    report = SequenceReport(safe_name(file.stem))
    try:
        video = VideoFile(file)
        for frame in video:
            check_shape(frame.size, next(iter(report.sizes), frame.size), f"{file}, frame {report.frames},")
            report.sizes[frame.size] += 1
            report.frames += 1
            advance(1)
    except BadInputError as error:
        report.unreadable.append(str(error))
        return report
    report.rate = video.fps
    report.unreadable += [video.damage] if video.damage else []
    return report


def links_out(path: Path) -> list[Path]:
    """The symbolic links in a folder that lead out of it, or nowhere."""
    root = path.resolve()
    return [link for link in sorted(path.rglob("*")) if link.is_symlink() and not _inside(link, root)]


def _inside(link: Path, root: Path) -> bool:
    try:
        return link.resolve(strict=True).is_relative_to(root)
    except (OSError, RuntimeError):  # nothing there; a circle of links
        return False


def size_on_disk(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return sum(file.stat().st_size for file in (path, *path.rglob("*")) if file.is_file())


def remarks(report: DataSetReport) -> list[str]:
    """What a user should know of a data set before using it, a sentence each."""
    said, spec = list(report.problems), report.dataset.spec
    if report.links:
        said.append(f"{len(report.links)} links lead out of the folder, or nowhere; the first: {report.links[0]}")
    for sequence in report.sequences:
        said += sequence.unreadable[:3]
        if len(sequence.unreadable) > 3:
            said.append(f"{sequence.name}: {len(sequence.unreadable) - 3} more files do not open")
        for part in spec.has:
            lacking = sequence.frames - len(sequence.unreadable) - sequence.parts[part]
            if lacking > 0:
                count = "no" if not sequence.parts[part] else f"{lacking} frames without"
                said.append(f"{sequence.name}: {count} {part}")
        if sequence.frames == 1:
            said.append(f"{sequence.name}: a single frame makes no pair")
        said += [f"{sequence.name}: {note}" for note in sequence.notes]
        if sequence.steps_back:
            said.append(
                f"{sequence.name}: time steps back {sequence.steps_back} times: frames are not in order, rename the files"
            )
        if sequence.depth_known:
            said.append(f"{sequence.name}: {np.mean(sequence.depth_known):.0%} of the pixels have a depth")
        if sequence.contrast and np.median(sequence.contrast) < FLAT:
            said.append(f"{sequence.name}: images without contrast: few points or none will be found in them")
        if _stands_still(sequence):
            said.append(
                f"{sequence.name}: the camera stands still (at most {sequence.path_metres:.3f} m and "
                f"{sequence.turn_degrees:.1f} degrees): good to try loaders and stereo with, of no use to train on"
            )
        if len(sequence.sizes) > 1 and sequence.temporal:
            said.append(f"{sequence.name}: images of {len(sequence.sizes)} different sizes")
    complete = all(s.parts[part] == s.frames for s in report.sequences for part in spec.has)
    if report.whole and complete and len(spec.inliers) > 1:
        said.append(f"inliers={', '.join(spec.inliers[:-1])} or {spec.inliers[-1]} labels and verifies its pairs")
    if report.whole and not spec.has:
        said.append("images alone, without poses or depth: inliers=klt labels and verifies them")
    return said


def _stands_still(sequence: SequenceReport) -> bool:
    if sequence.path_metres is None or sequence.turn_degrees is None:
        return False
    return sequence.path_metres < STILL_METRES and sequence.turn_degrees < STILL_DEGREES
