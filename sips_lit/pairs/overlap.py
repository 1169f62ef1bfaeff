"""The overlap index: which later frames of a sequence still show what a frame shows (paper, pair selection)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import apply_homography
from sips_lit.pairs.motion import as_complex, motion_of
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import GreyImage, ImageSequence

VERSION = 5
MIN_TEXTURE = 1e-5
MOTION_TRACKS = 128  # of which the motion is measured, at most twice as many
USUAL_BEST = 95  # percentile of the cells: the texture of a good corner, whatever the strongest edge of light is


@dataclass(frozen=True, slots=True)
class OverlapParameters:
    """How overlap is measured.

    ``spacing``: pixels between the points that are tracked (one per cell of a grid, replenished in every frame);
    ``quality``: only corners are, with at least this fraction of the texture of a good corner of the frame, as a detector
    could choose them: a place on the road or in the sky is not lost from view when its track is lost;
    ``max_span``: frames after which a track is given up, which bounds the memory for a camera that stands still;
    ``cut_survival``: where less than this fraction of the points survives one step, the shot was cut and all end there.
    """

    tracker: KltTracker = field(default_factory=KltTracker)
    spacing: int = 16
    quality: float = 0.03
    max_span: int = 200
    cut_survival: float = 0.15

    def signature(self, sequence: ImageSequence) -> dict[str, Any]:
        """What an index depends on; a stored one with another signature is stale."""
        frames = {"name": sequence.name, "fingerprint": sequence.fingerprint, "frames": len(sequence)}
        return {"version": VERSION, **asdict(self), "tracker": dict(self.tracker.parameters), **frames}


@dataclass(frozen=True, slots=True)
class PartnerCount:
    """How many ``frames`` have a later one with enough overlap, and how many ``pairs`` these are."""

    frames: int
    pairs: int


@dataclass(frozen=True, slots=True)
class OverlapIndex:
    """Overlap of each of N frames with its later frames, until none is left.

    Row i of the table is ``survivors[offsets[i]:offsets[i + 1]]``: how many of the ``points[i]`` points of frame i are still
    tracked in frames i + 1, i + 2, ...; it never grows along a row, unless the order of the frames means nothing.
    ``motion`` (P, 3), row by row like the table: how these points moved, by the median distance in pixels, and by the turn
    in degrees and the binary logarithm of the zoom of the similarity that fits them best (least squares).
    ``unreadable`` tells of each frame that can't be read, why: it has no points, and no row goes on beyond it where
    frames have an order.
    """

    survivors: NDArray[np.uint16]
    motion: NDArray[np.float16]
    offsets: NDArray[np.int64]
    points: NDArray[np.int64]
    unreadable: Mapping[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.points)

    def overlap(self, index: int) -> NDArray[np.float64]:
        """Overlap of frame ``index`` with frames index + 1, index + 2, ...; zero beyond the end."""
        row = self.survivors[self.offsets[index] : self.offsets[index + 1]]
        return np.asarray(row / max(1, self.points[index]), np.float64)

    def motion_to(self, index: int) -> NDArray[np.float16]:
        """``motion`` (F, 3) from frame ``index`` to frames index + 1, index + 2, ..., as far as `overlap` is not zero."""
        return self.motion[self.offsets[index] : self.offsets[index + 1]]

    def difficulty(self, index: int) -> NDArray[np.int64]:
        """For each frame that `motion_to` tells of, a number (F,) that those of like overlap and motion share.

        Classes (our choice): steps of 0.2 of the overlap; powers of two of the distance from 8 pixels on; turns from 15 and
        45 degrees on; zooms from 1.2 and 1.7 on.
        """
        moved, turn, zoom = np.abs(self.motion_to(index).astype(np.float64).T)
        overlaps, distances = np.minimum(self.overlap(index) // 0.2, 4), np.log2(np.maximum(moved, 4) / 4) // 1
        parts = [
            overlaps,
            np.minimum(distances, 5),
            np.digitize(turn, (15, 45)),
            np.digitize(zoom, np.log2((1.2, 1.7))),
        ]
        numbers = np.ravel_multi_index([part.astype(np.int64) for part in parts], (5, 6, 3, 3))
        return np.asarray(numbers, np.int64)

    def reach(self, overlap: float, below: float = math.inf) -> NDArray[np.int64]:
        """For each frame (N,) how many later frames have at least this overlap, and less than ``below``."""
        row_of = np.repeat(np.arange(len(self)), np.diff(self.offsets))
        # the quotient as in `overlap`: a product of the target would miss some that are reached exactly
        overlaps = self.survivors / np.maximum(1, self.points[row_of])
        enough = (overlaps >= max(overlap, 1e-9)) & (overlaps < below)
        return np.bincount(row_of, weights=enough, minlength=len(self)).astype(np.int64)

    def partners(self, index: int, overlap: float, below: float = math.inf) -> NDArray[np.int64]:
        """The later frames that `reach` counts for frame ``index``, in order."""
        overlaps = self.overlap(index)
        return index + 1 + np.flatnonzero((overlaps >= max(overlap, 1e-9)) & (overlaps < below))

    def count(self, overlap: float, below: float = math.inf) -> PartnerCount:
        """How many frames `reach` finds partners for, and how many."""
        reach = self.reach(overlap, below)
        return PartnerCount(int(np.count_nonzero(reach)), int(reach.sum()))

    def read(self) -> OverlapIndex:
        """Itself: an index that is in a file is read by this (`StoredIndex`)."""
        return self

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays."""
        return self.survivors.nbytes + self.motion.nbytes + self.offsets.nbytes + self.points.nbytes

    def part(self, start: int, stop: int) -> OverlapIndex:
        """The index of frames ``start`` to ``stop`` (exclusive), counted from ``start``."""
        if stop - start == len(self):
            return self
        lengths = np.minimum(np.diff(self.offsets[start : stop + 1]), np.arange(stop - start)[::-1])
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        kept = np.arange(offsets[-1]) + np.repeat(self.offsets[start:stop] - offsets[:-1], lengths)
        unreadable = {index - start: why for index, why in self.unreadable.items() if start <= index < stop}
        return OverlapIndex(self.survivors[kept], self.motion[kept], offsets, self.points[start:stop], unreadable)


Row = tuple[NDArray[np.uint16], NDArray[np.float16]]
NO_ROW: Row = np.zeros(0, np.uint16), np.zeros((0, 3), np.float16)


def measure_overlap(
    sequence: ImageSequence, parameters: OverlapParameters, on_frame: Callable[[], object] = lambda: None
) -> OverlapIndex:
    """Index of a sequence: by KLT in one pass over its frames, or by geometry where it knows its homographies.

    A frame that can't be read is a break in the sequence. Raises BadInputError when at least half of them can't.
    Only two frames are held at a time; what grows with the video is the index itself, by at most 8 ``max_span`` bytes a
    frame.
    """
    planar = len(sequence) > 1 and sequence.homography(0, 1) is not None
    points: list[int] = []
    rows: list[Row] = []
    unreadable: dict[int, str] = {}

    def read(index: int) -> GreyImage | None:
        try:
            return sequence.frame(index)
        except BadInputError as error:
            unreadable[index] = str(error)
            if 2 * len(unreadable) >= len(sequence):
                raise BadInputError(
                    f"half of the frames of {sequence.name} can't be read; the first of them: {min(unreadable.items())[1]}"
                ) from error
            return None

    measured = _map_all(sequence, read, parameters) if planar else _track_all(len(sequence), read, parameters)
    for point_count, finished in measured:
        points.append(point_count)
        rows += finished
        on_frame()
    return _as_index(rows, np.array(points, np.int64), unreadable)


def _as_index(rows: Sequence[Row], points: NDArray[np.int64], unreadable: Mapping[int, str]) -> OverlapIndex:
    offsets = np.concatenate([[0], np.cumsum([len(survivors) for survivors, _ in rows])]).astype(np.int64)
    survivors, motion = zip(*rows, NO_ROW, strict=True)
    return OverlapIndex(np.concatenate(survivors), np.concatenate(motion), offsets, points, unreadable)


def _row(survivors: Sequence[int], motion: Sequence[NDArray[np.float16]]) -> Row:
    counts = np.minimum(survivors, np.iinfo(np.uint16).max)
    return np.asarray(counts, np.uint16), np.asarray(motion, np.float16).reshape(-1, 3)


def _map_all(
    sequence: ImageSequence, read: Callable[[int], GreyImage | None], parameters: OverlapParameters
) -> Iterator[tuple[int, list[Row]]]:
    """As `_track_all`, for points of a regular grid that known homographies carry along while they stay in view.

    Where the order of the frames means nothing a point need not be in view in the frames between, and none is in view in a
    frame that can't be read.
    """
    spacing, sizes = parameters.spacing, _sizes(sequence, read)
    for index, size in enumerate(sizes):
        survivors: list[int] = []
        motion: list[NDArray[np.float16]] = []
        width, height = size or (0, 0)
        grid = np.mgrid[spacing // 2 : width : spacing, spacing // 2 : height : spacing].reshape(2, -1).T
        seen = grid.astype(np.float64)
        for later in range(index + 1, min(len(sequence), index + 1 + parameters.max_span)):
            H = sequence.homography(index, later)
            assert H is not None
            with np.errstate(invalid="ignore"):
                moved = apply_homography(H, seen)
                inside = ((moved >= 0) & (moved <= np.array(sizes[later] or (0, 0)) - 1)).all(1)
            if sequence.temporal:
                seen = seen[inside]
                if not len(seen):
                    break
            survivors.append(int(inside.sum()))
            begins = seen if sequence.temporal else seen[inside]
            motion += list(motion_of(as_complex(begins)[None], as_complex(moved[inside]), inside.sum(keepdims=True)))
        yield len(grid), [_row(survivors, motion)]


def _sizes(sequence: ImageSequence, read: Callable[[int], GreyImage | None]) -> list[tuple[int, ...] | None]:
    """The size (W, H) of each frame, None where it can't be read.

    The frames of a moving camera have one size, that of the first that can be read; the others are not looked at.
    """
    sizes: list[tuple[int, ...] | None] = []
    for index in range(len(sequence)):
        image = read(index)
        sizes.append(None if image is None else image.shape[::-1])
        if sequence.temporal and image is not None:
            return sizes + sizes[-1:] * (len(sequence) - len(sizes))
    return sizes


def _track_all(
    length: int, read: Callable[[int], GreyImage | None], parameters: OverlapParameters
) -> Iterator[tuple[int, list[Row]]]:
    """For each frame how many points it has, and the rows that end here, in the order of their frames.

    ``read`` gives a frame, or None where it can't be read: all tracks end there.
    One set of tracks serves all frames: the points of frame i are those alive in it, so its survivors in frame j are the
    tracks alive in j that were born in i or before. An earlier frame has fewer survivors, so rows end in order.
    """
    xy, born = np.zeros((0, 2), np.float32), np.zeros(0, np.int64)
    open_rows: dict[int, tuple[list[int], list[NDArray[np.float16]]]] = {}
    places = np.zeros((0, 0), np.complex128)  # of the tracks in all frames from `first` on
    previous: GreyImage | None = None
    for index in range(length):
        image = read(index)
        if previous is None or image is None:
            xy, born, places = xy[:0], born[:0], places[:, :0]
        else:
            xy, held = parameters.tracker.step(previous, image, xy)
            if held.sum() < parameters.cut_survival * len(held):
                held[:] = False
            xy, born, places = xy[held], born[held], places[:, held]
        finished = []
        first = max(0, index - parameters.max_span)
        places = places[len(places) - (index - first) :]
        alive = np.cumsum(np.bincount(np.maximum(born, first) - first, minlength=index - first + 1))
        some = slice(None, None, max(1, len(xy) // MOTION_TRACKS))
        of_some = np.searchsorted(born[some], np.arange(first, index), "right")
        motion = motion_of(places[:, some], as_complex(xy[some]), of_some)
        for row in list(open_rows):
            survivors = int(alive[row - first]) if row >= first else 0
            if survivors:
                open_rows[row][0].append(survivors)
                open_rows[row][1].append(motion[row - first])
            else:
                finished.append(_row(*open_rows.pop(row)))
        fresh = np.zeros((0, 2), np.float32) if image is None else corners_to_track(image, xy, parameters)
        xy, born = np.concatenate([xy, fresh]), np.concatenate([born, np.full(len(fresh), index)])
        unborn = np.full((len(places), len(fresh)), np.nan)
        places = np.concatenate([np.concatenate([places, unborn], 1), as_complex(xy)[None]])
        open_rows[index] = [], []
        if index == length - 1:
            finished += [_row(*row) for row in open_rows.values()]
        previous = image
        yield len(xy), finished


def corners_to_track(image: GreyImage, xy: NDArray[np.float32], parameters: OverlapParameters) -> NDArray[np.float32]:
    """New points (M, 2): the best-textured pixel of each grid cell with a corner but no point, not close to any other point.

    Texture is the smaller eigenvalue of the structure tensor, at half resolution: KLT refines the place anyway.
    """
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    block = max(1, parameters.spacing // 4)  # a cell is 2 x 2 blocks of the half-size image
    rows, columns = half.shape[0] // (2 * block), half.shape[1] // (2 * block)
    if not rows or not columns:
        return np.zeros((0, 2), np.float32)
    near = np.zeros((2 * rows, 2 * columns), np.uint8)
    taken = (xy / (2 * block)).astype(np.int64)
    taken = taken[(taken < [2 * columns, 2 * rows]).all(1)]
    near[taken[:, 1], taken[:, 0]] = 1
    free = cv2.dilate(near, np.ones((3, 3), np.uint8)) == 0
    texture = cv2.cornerMinEigenVal(half, 3)[: 2 * block * rows, : 2 * block * columns]
    strongest = texture.reshape(rows, 2 * block, columns, 2 * block).max((1, 3))
    enough = max(MIN_TEXTURE, parameters.quality * float(np.percentile(strongest, USUAL_BEST)))
    texture = texture.reshape(2 * rows, block, 2 * columns, block) * free[:, None, :, None]
    cells = texture.reshape(rows, 2 * block, columns, 2 * block).swapaxes(1, 2).reshape(rows, columns, -1)
    best = cells.argmax(2)
    row, column = np.nonzero(cells.max(2) > enough)
    inside = best[row, column]
    y, x = row * 2 * block + inside // (2 * block), column * 2 * block + inside % (2 * block)
    return np.stack([2 * x + 0.5, 2 * y + 0.5], 1).astype(np.float32)
