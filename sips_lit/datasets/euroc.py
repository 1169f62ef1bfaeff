"""EuRoC MAV: stereo from a drone with true poses (Burri et al., IJRR 2016), rectified as it is read.

TUM-VI (Schubert et al., IROS 2018) has the same layout, equidistant lenses, 16-bit images, and poses in mocap0.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.asl import LAYOUT, read_mounting, read_sensor, read_states, read_timed_images, sensor_file
from sips_lit.datasets.layout import expect_size, files_fingerprint, wrong_layout
from sips_lit.datasets.measured import MeasuredSequence, joined_in_time
from sips_lit.datasets.spec import DatasetSpec, any_of
from sips_lit.errors import BadInputError, warn_input
from sips_lit.files import safe_name
from sips_lit.frames.image_cache import image_cache
from sips_lit.frames.image_size import image_size
from sips_lit.frames.images import check_max_side, read_grey, read_values, resize_max_side, shrunk_size
from sips_lit.frames.listing import LEFT_BEHIND
from sips_lit.frames.span import Span, find_span
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.geometry.rectify import Rectifier, rectify_mono, rectify_stereo
from sips_lit.types import FloatArray, GreyImage, ImageSequence

NANOSECONDS = 1e9  # in a second
log = logging.getLogger(__name__)


class EurocSequence(MeasuredSequence):
    """The images of cam0 of one sequence (``mav0`` is its folder), with those of cam1 as right images.

    Rectified: images, camera and poses are of the pinhole camera that replaces cam0. Otherwise the images are as they are
    stored, poses are of cam0, and there is neither camera nor right image: a `Camera` has no lens distortion. Rectified
    images are kept in ``cache_dir``, if given. Raises BadInputError when something is missing or does not fit.
    """

    def __init__(
        self, mav0: Path, name: str, rectify: bool, tolerance: float, max_side: int | None, cache_dir: str | Path | None
    ) -> None:
        left = read_timed_images(mav0 / "cam0")
        sensor = sensor_file(mav0 / "cam0")
        self.name, self.max_side, self.files, self._times = safe_name(name), max_side, left.files, left.times * 1e-9
        read = [*([sensor] if rectify or sensor.exists() else []), mav0 / "cam0" / "data.csv", *left.files]
        T_body_camera: FloatArray | None = None
        if rectify:
            lens, T_body_camera = read_sensor(sensor, "cam0")
            self.size = lens.size  # as stored
        elif sensor.exists():
            self.size, T_body_camera = read_mounting(sensor, "cam0")
        else:
            warn_input(f"there is no {sensor}: where the camera is on the body is not known, and so no pose")
            self.size = image_size(left.files[0])
        self._rectifier: Rectifier | None = None
        self._partners: list[Path | None] = [None] * len(left.files)
        if T_body_camera is not None and rectify and (mav0 / "cam1").is_dir():
            right_sensor = sensor_file(mav0 / "cam1")
            right_lens, T_body_right = read_sensor(right_sensor, "cam1")
            if right_lens.size != lens.size:
                raise BadInputError(
                    f"the cameras of {mav0} have images of {lens.size} and {right_lens.size}: no stereo pair"
                )
            T_right_camera = np.linalg.inv(T_body_right) @ T_body_camera
            self._rectifier, self._right_rectifier, self._baseline = rectify_stereo(lens, right_lens, T_right_camera)
            right = read_timed_images(mav0 / "cam1")
            self._partners = joined_in_time(left.times, right.times, right.files, NANOSECONDS * tolerance)
            self._warn_of(self._partners, "right image", tolerance)
            read += [right_sensor, mav0 / "cam1" / "data.csv", *right.files]
        elif rectify:
            self._rectifier = rectify_mono(lens)
        if self._rectifier is not None:
            self._camera = resize_camera(self._rectifier.camera, shrunk_size(self.size, max_side))
        truths = (mav0 / place / "data.csv" for place in ("state_groundtruth_estimate0", "mocap0"))
        truth = next((table for table in truths if table.exists()), None)
        if truth is not None and T_body_camera is not None:
            read.append(truth)
            self._poses = self._poses_from(truth, left.times, T_body_camera, tolerance)
        self.fingerprint = files_fingerprint(read, "euroc 2", rectify, tolerance, max_side)
        self._kept = image_cache(cache_dir if rectify else None, self.name, self.fingerprint)

    def frame(self, index: int) -> GreyImage:
        """Image ``index`` of cam0. Raises BadInputError when it can't be read or its size is not that of sensor.yaml."""
        file = self.files[index]
        return self._kept(f"cam0_{file.stem}", lambda: self._read(file, self._rectifier))

    def right(self, index: int) -> GreyImage | None:
        """Image of cam1; None if not rectified, without cam1, or where it has none near that time."""
        file = self._partners[index]
        return (
            None if file is None else self._kept(f"cam1_{file.stem}", lambda: self._read(file, self._right_rectifier))
        )

    @functools.cached_property
    def _span(self) -> Span:
        """Which 16-bit values become 0 to 255: one span for all images, right ones, too."""
        return find_span(len(self), lambda index: read_values(self.files[index]))

    def _read(self, file: Path, rectifier: Rectifier | None) -> GreyImage:
        image = read_grey(file, self._span)
        expect_size(image, self.size, str(file), "its sensor.yaml says")
        return resize_max_side(image if rectifier is None else rectifier(image), self.max_side)

    def _poses_from(
        self, truth: Path, times: NDArray[np.int64], T_body_camera: FloatArray, tolerance: float
    ) -> list[NDArray[np.float64] | None]:
        """The pose of each frame from the state nearest in time, None where none is near."""
        states = read_states(truth)
        poses = joined_in_time(times, states.times, states.T_world_body, NANOSECONDS * tolerance)
        if all(T_world_body is None for T_world_body in poses):
            spans = [f"{t[0] * 1e-9:.3f} to {t[-1] * 1e-9:.3f} s" for t in (states.times, times)]
            raise BadInputError(
                f"{truth} is from {spans[0]} and the images of cam0 from {spans[1]}: the ground truth does not overlap in "
                f"time within data.tolerance={tolerance:g} s, so it is of another sequence or clock"
            )
        self._warn_of(poses, "pose", tolerance)
        T_camera_rectified = np.eye(4)
        if self._rectifier is not None:
            T_camera_rectified[:3, :3] = self._rectifier.rotation.T
        T_body_rectified = T_body_camera @ T_camera_rectified
        return [None if T_world_body is None else T_world_body @ T_body_rectified for T_world_body in poses]

    def _warn_of(self, parts: Sequence[object], what: str, tolerance: float) -> None:
        lacking = sum(part is None for part in parts)
        if lacking:
            log.warning("%s: %d of %d frames have no %s within %g s", self.name, lacking, len(parts), what, tolerance)


def euroc(
    path: str | Path,
    rectify: bool = True,
    tolerance: float = 0.005,
    max_side: int | None = None,
    cache_dir: str | Path | None = None,
) -> list[ImageSequence]:
    """Sequences of EuRoC: ``path`` is a folder with ``mav0``, ``mav0`` itself, or a folder of such folders.

    ``rectify``: pinhole images with aligned rows; ``tolerance``: how far apart an image, its right partner and its pose may
    be (seconds); ``max_side``: shrink images whose longer side exceeds it (pixels), with their camera; ``cache_dir`` keeps
    what was rectified. Raises BadInputError when what is there is not whole, or the truth is of another time.
    """
    check_max_side(max_side)
    if not tolerance >= 0:
        raise BadInputError(f"data.tolerance is {tolerance:g}: it must be at least 0 seconds")
    return [
        EurocSequence(mav0, name, rectify, tolerance, max_side, cache_dir)
        for name, mav0 in _sequence_folders(Path(path).resolve()).items()
    ]


def _sequence_folders(path: Path) -> dict[str, Path]:
    """The folders ``mav0`` by the names of their sequences."""
    if (path / "cam0").is_dir():
        return {path.parent.name: path}
    for pattern in ("mav0", "[!.]*/mav0", "[!.]*/[!.]*/mav0"):  # a sequence; several; rooms of several
        found = [
            mav0.parent for mav0 in sorted(path.glob(pattern)) if mav0.is_dir() and not LEFT_BEHIND & set(mav0.parts)
        ]
        if found:
            return {"_".join(folder.relative_to(path).parts) or path.name: folder / "mav0" for folder in found}
    raise wrong_layout(f"mav0 in {path} or in its folders", path, LAYOUT)


SPEC = DatasetSpec(
    kind="euroc",
    title="EuRoC / ASL",
    loader=euroc,
    signs=(any_of("mav0/cam0/sensor.yaml", "mav0", "cam0/sensor.yaml", "cam0/data.csv"),),
    family=True,
    has=("right images", "intrinsics", "poses", "times"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)
