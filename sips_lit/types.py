"""The records and protocols that pass between the stages: this file is the design.

Conventions (one place): a point is ``(x, y)`` float32 with (0, 0) at the *centre* of the top-left pixel; an image is
grey uint8 (H, W); ``T_a_b`` is 4x4 float64 and maps points of frame b into frame a; keypoints come sorted by score,
descending.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import cv2

GreyImage = NDArray[np.uint8]
"""(H, W) uint8."""
FloatArray = NDArray[np.floating[Any]]
Norm = Literal["l2", "hamming"]
ColorOrder = Literal["rgb", "bgr"]
"""The order of the channels of a colour image: Pillow's and PyTorch's, or that of `cv2.imread`."""
ScoreKind = Literal["probability", "order", "none"]
"""What scores mean: the probability of being an inlier; an order and nothing else; nothing, so points have no order."""


OPENCV_DIAMETER: Final = 8.0
"""Pixels at scale 1 of the neighbourhood that OpenCV's descriptors are told: that of `RootSift`."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera: ``matrix`` (3, 3) float64 in pixels, ``size`` (W, H) in pixels."""

    matrix: FloatArray
    size: tuple[int, int]


class ImageSequence(ABC):
    """Images of one moving camera in temporal order, with whatever else the data set knows about them.

    ``temporal`` is False where the order means nothing: every pair then stands for itself, and sizes may differ.

    ``name`` is unique within a run and safe as a file name. ``fingerprint`` changes whenever the frames change; caches
    and indexes are keyed by it. ``damage`` says what is missing of the file that the frames come from, None for nothing.
    Everything beyond ``frame`` is optional and is None where the data set lacks it.
    """

    name: str
    fingerprint: str
    temporal: bool = True
    damage: str | None = None

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def frame(self, index: int) -> GreyImage:
        """Frame ``index`` as grey uint8 (H, W). Raises BadInputError when it cannot be read."""

    def frame_name(self, index: int) -> str:
        """What output files of frame ``index`` are called, without a suffix."""
        return f"{self.name}_{index:06d}"

    def camera(self, index: int) -> Camera | None:
        """Intrinsics of frame ``index``."""
        return None

    def pose(self, index: int) -> FloatArray | None:
        """``T_world_camera`` of frame ``index``, 4x4 float64, metres."""
        return None

    def depth(self, index: int) -> FloatArray | None:
        """Depth along the optical axis (H, W) float32 in metres; NaN where unknown."""
        return None

    def right(self, index: int) -> GreyImage | None:
        """The right image of a rectified stereo pair: a point at (x, y) is at (x - disparity, y) there."""
        return None

    def baseline(self) -> float | None:
        """Metres from the camera to the one of the right images."""
        return None

    def time(self, index: int) -> float | None:
        """When frame ``index`` was taken, in seconds."""
        return None

    def homography(self, index0: int, index1: int) -> FloatArray | None:
        """(3, 3) float64 that maps pixels of frame ``index0`` to pixels of frame ``index1``, for planar scenes."""
        return None

    def notes(self) -> list[str]:
        """What one should know of how the frames were read, a phrase each."""
        return []

    def source_range(self) -> tuple[ImageSequence, int, int]:
        """The sequence that the frames are a range of, and from where to where (exclusive): all of itself by default."""
        return self, 0, len(self)


@dataclass(frozen=True, slots=True)
class ViewGeometry:
    """Known geometry of a pair: cameras, ``T_1_0`` (4, 4), depth maps (H, W) in metres with NaN where unknown.

    ``T_1_0`` is None where poses are not known. One of the depth maps may be None: then points that are hidden there are not
    noticed. Without a map the rectified stereo partner of an image, ``right0`` or ``right1`` (H, W), may tell the depth; it
    is ``baseline`` metres to the right (to the left if negative: a mirror swaps the sides). Without either, the points of
    that image are known only through their matches.
    """

    T_1_0: FloatArray | None
    camera0: Camera
    camera1: Camera
    depth0: FloatArray | None
    depth1: FloatArray | None
    right0: GreyImage | None = None
    right1: GreyImage | None = None
    baseline: float | None = None


@dataclass(frozen=True, slots=True)
class FramePair:
    """Two frames of a sequence and everything between them.

    ``frames`` holds every image from ``index0`` to ``index1`` in that order, both ends included (so it may run back in
    time); trackers use these. ``image0`` and ``image1`` are what detectors and descriptors see: the ends of ``frames``,
    photometrically augmented in training. ``homography`` maps pixels of image 0 to image 1.
    """

    name: str
    index0: int
    index1: int
    frames: tuple[GreyImage, ...]
    image0: GreyImage
    image1: GreyImage
    homography: FloatArray | None = None
    geometry: ViewGeometry | None = None


@dataclass(frozen=True, slots=True)
class Keypoints:
    """N points of one image, best first.

    ``xy`` (N, 2) float32 pixels; ``score`` (N,) float32, descending (for SIPs the probability of being an inlier);
    ``scale`` (N,) float32, the size of the point relative to the finest scale (1 = full resolution); ``depth`` (N,) float64
    along the optical axis in metres, NaN where unknown, or None where it was not measured; ``covariance`` (N, 2, 2) float32
    of ``xy`` in pixels squared, or None where the detector does not know how sure a place is.
    """

    xy: NDArray[np.float32]
    score: NDArray[np.float32]
    scale: NDArray[np.float32]
    depth: NDArray[np.float64] | None = None
    covariance: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, rows: NDArray[Any] | slice) -> Keypoints:
        """Some of the points, by a mask, by positions or by a slice."""
        depth = None if self.depth is None else self.depth[rows]
        covariance = None if self.covariance is None else self.covariance[rows]
        return Keypoints(self.xy[rows], self.score[rows], self.scale[rows], depth, covariance)

    def best(self, n: int) -> Keypoints:
        """The first ``n`` points (all, if there are fewer)."""
        return self[:n]

    def to_opencv(self, diameter: float = OPENCV_DIAMETER) -> list[cv2.KeyPoint]:
        """N OpenCV keypoints in the same order and pixels, upright (angle 0), with the scores as responses.

        ``size`` is ``diameter`` (pixels) times the scale of the point.
        """
        import cv2  # these records load without it

        rows = zip(self.xy.tolist(), self.score.tolist(), self.scale.tolist(), strict=True)
        return [cv2.KeyPoint(x, y, diameter * scale, angle=0, response=score) for (x, y), score, scale in rows]

    @staticmethod
    def empty() -> Keypoints:
        """No points."""
        none = np.zeros(0, np.float32)
        return Keypoints(np.zeros((0, 2), np.float32), none, none)


@dataclass(frozen=True, slots=True)
class Features:
    """Keypoints with their ``descriptors`` (N, D): float32 compared by ``l2``, or packed uint8 by ``hamming``."""

    keypoints: Keypoints
    descriptors: NDArray[Any]
    norm: Norm

    def __len__(self) -> int:
        return len(self.keypoints)

    def __getitem__(self, rows: NDArray[Any] | slice) -> Features:
        """The features of some of the points, by a mask, by positions or by a slice."""
        return Features(self.keypoints[rows], self.descriptors[rows], self.norm)

    def best(self, n: int) -> Features:
        """The features of the first ``n`` points (all, if there are fewer)."""
        return self[:n]


@dataclass(frozen=True, slots=True)
class Matches:
    """Match m joins point ``index0[m]`` of image 0 with point ``index1[m]`` of image 1; both (M,) int64."""

    index0: NDArray[np.int64]
    index1: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.index0)


class Reason(IntEnum):
    """Why a match, or a point, is an inlier or is not."""

    INLIER = 0
    UNMATCHED = 1
    """The point has no match (only for points)."""
    LOST = 2
    """No correspondence: the track broke, or the point leaves the other image or is hidden there."""
    FAR = 3
    """The match is further from the true correspondence than the threshold."""
    UNKNOWN = 4
    """The truth is not known here (no depth, say): the match is ignored, neither inlier nor outlier."""


@dataclass(frozen=True, slots=True)
class Inliers:
    """The answer of an inlier check for M matches between N0 and N1 points.

    ``inlier`` (M,) bool and ``reason`` (M,) uint8 (`Reason`), per match; ``known0`` (N0,) and ``known1`` (N1,) bool, per
    point: whether the truth about it is known (if not, it is ignored in training). ``residual`` (M, 2, 2) float32 pixels:
    from the matched point to where the point truly moves, (x, y) forward in image 1 and backward in image 0, NaN where
    that is not known; None where the check does not measure it.
    """

    inlier: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    known0: NDArray[np.bool_]
    known1: NDArray[np.bool_]
    residual: NDArray[np.float32] | None = None


class Detector(Protocol):
    """Finds points, and describes them itself if ``describes`` is true."""

    @property
    def name(self) -> str:
        """What tables call it."""

    @property
    def describes(self) -> bool:
        """Whether it has descriptors of its own."""

    @property
    def scores(self) -> ScoreKind:
        """What its scores mean."""

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points of ``image``, best first."""

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` points with the detector's own descriptors; only where ``describes`` is true."""

    def best(self, keypoints: Keypoints, n: int) -> Keypoints:
        """The first ``n`` of its points of an image, with the scores that they have when the others are not kept."""

    def score_map(self, image: GreyImage) -> FloatArray | None:
        """The score (H, W) of every pixel of ``image``, from 0 to 1, for pictures; None if it has no such map."""


class Descriptor(Protocol):
    """Describes given points."""

    @property
    def name(self) -> str:
        """What tables call it."""

    @property
    def norm(self) -> Norm:
        """How its descriptors are compared."""

    def describe(self, image: GreyImage, keypoints: Keypoints) -> NDArray[Any]:
        """(N, D) descriptors of the N keypoints, one each, whatever their distance to the border."""


class DisparityMatcher(Protocol):
    """Finds the disparity of points of an image in its rectified stereo partner."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Its thresholds, for results."""

    def disparity(
        self, image: GreyImage, partner: GreyImage, xy: FloatArray, to_the_right: bool = True
    ) -> NDArray[np.float64]:
        """Disparity (N,) in pixels of points (N, 2), positive, NaN where there is none.

        ``to_the_right``: the partner was taken to the right of the image.
        """


class PreparedCheck(Protocol):
    """An inlier check that has seen the pair and its points."""

    def __call__(self, matches: Matches, repeat: int = 0) -> Inliers:
        """Verifies M matches between these points. A check that draws random samples draws others for each ``repeat``."""


class InlierCheck(Protocol):
    """Says which matches of a pair are inliers, and why the others are not."""

    @property
    def independent(self) -> bool:
        """Whether the answer for a match does not depend on the other matches (ground truth, KLT).

        Then one call answers for every budget of points.
        """

    @property
    def uses_frames(self) -> bool:
        """Whether it looks at the frames between the two images; without it they need not be read."""

    @property
    def uses_depth(self) -> bool:
        """Whether it needs depth maps, or right images where there are none; without it they need not be read."""

    @property
    def stereo(self) -> DisparityMatcher | None:
        """How it wants depth to be found where there are stereo partners instead of maps; None if it does not care."""

    @property
    def protocol(self) -> Mapping[str, Any]:
        """The method and its thresholds, for results."""

    def prepare(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedCheck:
        """Does what depends on the points alone, for any number of sets of matches between them.

        Depth that the keypoints bring is taken as it is. Raises BadInputError for a pair that it cannot verify.
        """

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Verifies M matches between the points of both images; raises as `prepare`."""
