"""From selected points to labels: descriptors, matches, inliers (paper, label generation)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.image_changes import resize_map
from sips_lit.inliers.point_labels import PointLabels, point_labels
from sips_lit.matching.mutual_nearest import (
    FOREVER,
    MutualLifetimes,
    distances,
    mutual_nearest,
    mutual_nearest_lifetimes,
)
from sips_lit.train.step_times import Stopwatch
from sips_lit.types import (
    Descriptor,
    Features,
    FramePair,
    GreyImage,
    InlierCheck,
    Inliers,
    Keypoints,
    Matches,
    PreparedCheck,
)

Map = Callable[..., Iterable[Any]]
"""The built-in `map`, or the one of an executor that runs the calls side by side."""


def label_pair(
    pair: FramePair,
    keypoints0: Keypoints,
    keypoints1: Keypoints,
    descriptor: Descriptor,
    check: InlierCheck,
    parallel: Map = map,
    parts: int = 1,
    budgets: Sequence[int] = (),
    watch: Stopwatch | None = None,
) -> tuple[PointLabels, PointLabels, MutualLifetimes]:
    """Labels of the points of both images, best first, and the matches that are inliers.

    An image may be a smaller copy of its frame (the first or the last): its points are judged where they are in the frame.
    ``budgets``: numbers of points among which matches are looked for, too; the share of a point is that of the budgets
    with it in which its match is an inlier. Only checks that judge each match by itself can judge those.
    ``parallel`` may run up to ``parts`` calls at once; the labels don't change. ``watch`` gets the times of the stages
    describe, match and track, which is what the check does.
    """
    watch = watch or Stopwatch()
    with watch("describe"):
        described0, described1 = parallel(descriptor.describe, (pair.image0, pair.image1), (keypoints0, keypoints1))
    features0 = Features(keypoints0, described0, descriptor.norm)
    features1 = Features(keypoints1, described1, descriptor.norm)
    with watch("match"):
        apart = distances(features0, features1)
        whole = MutualLifetimes.of_all(mutual_nearest(apart))
    keypoints0 = in_frame(keypoints0, pair.image0, pair.frames[0])
    keypoints1 = in_frame(keypoints1, pair.image1, pair.frames[-1])
    with watch("track"):
        prepared = check.prepare(pair, keypoints0, keypoints1)
        judged = _in_parts(prepared, check.independent, whole.matches, parallel, parts)
    labels0 = _in_image(point_labels(judged, whole.index0, judged.known0), pair.image1, pair.frames[-1])
    labels1 = _in_image(point_labels(judged, whole.index1, judged.known1, 1), pair.image0, pair.frames[0])
    inliers = whole[judged.inlier]
    if budgets and check.independent:
        with watch("match"):
            lifetimes = mutual_nearest_lifetimes(apart)
        alive = [(lifetimes.first <= n) & (n <= lifetimes.last) for n in budgets]
        passing = lifetimes[(lifetimes.last < FOREVER) & np.any(alive, axis=0)]
        with watch("track"):
            inliers = inliers + passing[_in_parts(prepared, True, passing.matches, parallel, parts).inlier]
        labels0 = replace(labels0, share=_shares(labels0.inlier, inliers, inliers.index0, budgets))
        labels1 = replace(labels1, share=_shares(labels1.inlier, inliers, inliers.index1, budgets))
    return labels0, labels1, inliers


def label_along(
    pair: FramePair,
    keypoints0: Keypoints,
    keypoints1: Keypoints,
    between: Mapping[int, tuple[GreyImage, Keypoints]],
    label: Callable[[FramePair, Keypoints, Keypoints], tuple[PointLabels, PointLabels, MutualLifetimes]],
) -> tuple[PointLabels, PointLabels, MutualLifetimes]:
    """What ``label`` says of a pair, but the share of a point is its mean over the other image and some images ``between``.

    These and their points are given by their position in ``pair.frames``: a point counts in how many of them it is selected
    again, matched and found by the tracker. Inliers stay those of the pair (our choice).
    """
    labels0, labels1, inliers = label(pair, keypoints0, keypoints1)
    shares0, shares1 = [labels0.share], [labels1.share]
    for position, (image, keypoints) in between.items():
        before = replace(pair, frames=pair.frames[: position + 1], image1=image)
        after = replace(pair, frames=pair.frames[position:], image0=image)
        shares0.append(label(before, keypoints0, keypoints)[0].share)
        shares1.append(label(after, keypoints, keypoints1)[1].share)
    labels0 = replace(labels0, share=np.mean(shares0, 0, np.float32))
    labels1 = replace(labels1, share=np.mean(shares1, 0, np.float32))
    return labels0, labels1, inliers


def images_between(pair: FramePair, most: int) -> dict[int, GreyImage]:
    """At most ``most`` of the frames between both ends, evenly spread, by position; as large as image 0 of the pair."""
    last = len(pair.frames) - 1
    count = min(most, last - 1)
    positions = [round((at + 1) * last / (count + 1)) for at in range(count)]
    return {position: _resized(pair.frames[position], pair.image0) for position in positions}


def _resized(frame: GreyImage, as_large_as: GreyImage) -> GreyImage:
    height, width = as_large_as.shape
    if frame.shape == (height, width):
        return frame
    return np.asarray(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _shares(
    whole: NDArray[np.bool_], inliers: MutualLifetimes, points: NDArray[np.int64], budgets: Sequence[int]
) -> NDArray[np.float32]:
    """The share (N,) of the budgets with a point, all points among them, in which its match is an inlier."""
    count, total = whole.astype(np.float32), np.ones(len(whole), np.float32)
    for n in budgets:
        if n < len(whole):
            count[points[(inliers.first <= n) & (n <= inliers.last)]] += 1
            total[:n] += 1
    return count / total


def in_frame(keypoints: Keypoints, image: GreyImage, frame: GreyImage) -> Keypoints:
    """Keypoints of an image in the frame of which it is a resized copy; the same where both have one size."""
    if image.shape == frame.shape:
        return keypoints
    H = resize_map(image.shape[::-1], frame.shape[::-1])
    xy = keypoints.xy @ H[:2, :2].T + H[:2, 2]
    return replace(keypoints, xy=xy.astype(np.float32), scale=keypoints.scale * np.float32(np.sqrt(H[0, 0] * H[1, 1])))


def _in_image(labels: PointLabels, other: GreyImage, frame: GreyImage) -> PointLabels:
    """Labels with residuals in the pixels of the other image, of those in the frame of which it is a resized copy."""
    if labels.residual is None or other.shape == frame.shape:
        return labels
    pixels = np.array(other.shape[::-1]) / np.array(frame.shape[::-1])
    return replace(labels, residual=(labels.residual * pixels).astype(np.float32))


def _in_parts(check: PreparedCheck, independent: bool, matches: Matches, parallel: Map, parts: int) -> Inliers:
    if parts == 1 or not independent:
        return check(matches)
    chunks = map(Matches, np.array_split(matches.index0, parts), np.array_split(matches.index1, parts))
    answers = list(parallel(check, chunks))
    return Inliers(
        np.concatenate([answer.inlier for answer in answers]),
        np.concatenate([answer.reason for answer in answers]),
        np.any([answer.known0 for answer in answers], axis=0),
        np.any([answer.known1 for answer in answers], axis=0),
        _joined([answer.residual for answer in answers]),
    )


def _joined(residuals: Sequence[NDArray[np.float32] | None]) -> NDArray[np.float32] | None:
    measured = [residual for residual in residuals if residual is not None]
    return np.concatenate(measured) if len(measured) == len(residuals) else None
