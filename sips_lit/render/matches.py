"""The matches of a pair and how they fared, as in the supplement of the paper (Cieslewski et al., 3DV 2019)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.render.canvas import BLACK, Colour, Picture, draw_lines, draw_point, probability_colours, to_picture
from sips_lit.render.caption import GROUND, caption, probability_key, ring_key, words
from sips_lit.render.points import RADIUS
from sips_lit.types import FloatArray, Inliers, Keypoints, Matches, Reason

# After Okabe and Ito: distinct for colour-blind eyes, too; the green is brightened for grey images.
COLOURS: Final[dict[Reason, Colour]] = {
    Reason.INLIER: (0, 205, 140),
    Reason.UNMATCHED: (86, 180, 233),
    Reason.LOST: (204, 121, 167),
    Reason.FAR: (226, 94, 0),
    Reason.UNKNOWN: (240, 228, 66),
}
_GAP: Final = 6
_TEXT, _LEAST_TEXT = 18, 11  # pixels, of text in a picture of full size, and in small ones
AT_FULL_SIZE: Final = 640
"""Pixels of a picture's width up to which it is taken to be shown as it is; a wider one is shown smaller, as TensorBoard
does, so its overlays and its text grow with it."""


def draw_matches(
    image0: NDArray[np.uint8],
    image1: NDArray[np.uint8],
    keypoints0: Keypoints,
    keypoints1: Keypoints,
    matches: Matches,
    inliers: Inliers,
    score_map0: FloatArray | None = None,
    score_map1: FloatArray | None = None,
    name: str = "",
    shown_width: int = AT_FULL_SIZE,
) -> Picture:
    """Both images side by side, beneath them their score maps (probabilities, as large as the image): RGB uint8.

    Each point is a circle as thick as its probability in the colour of its `Reason`; lines join inlier matches. The
    caption has the ``name`` of the pair if it is given, counts, and tells what colours mean. The images may differ in size,
    and either score map may be missing. A picture wider than ``shown_width`` is taken to be shown so wide.
    """
    rows: list[tuple[Picture | None, Picture | None]] = [(to_picture(image0), to_picture(image1))]
    maps = [None if scores is None else probability_colours(scores) for scores in (score_map0, score_map1)]
    if any(picture is not None for picture in maps):
        rows.append((maps[0], maps[1]))
    height, left1 = max(image0.shape[0], image1.shape[0]), image0.shape[1] + _GAP
    width = left1 + image1.shape[1]
    scale = max(1.0, width / shown_width)
    reasons0 = _point_reasons(matches.index0, inliers.reason, inliers.known0)
    reasons1 = _point_reasons(matches.index1, inliers.reason, inliers.known1)

    panels: list[Picture] = []
    for picture0, picture1 in rows:
        row: Picture = np.full((height, width, 3), GROUND, np.uint8)
        sides = (
            (picture0, row[:, : left1 - _GAP], keypoints0, reasons0),
            (picture1, row[:, left1:], keypoints1, reasons1),
        )
        for picture, side, _, _ in sides:
            if picture is not None:
                side[: picture.shape[0], : picture.shape[1]] = picture
        if not panels:
            ends0 = keypoints0.xy[matches.index0[inliers.inlier]]
            ends1 = keypoints1.xy[matches.index1[inliers.inlier]] + np.array([left1, 0], np.float32)
            draw_lines(row, ends0, ends1, BLACK, opacity=0.35, thickness=int(scale) + 2)
            draw_lines(row, ends0, ends1, COLOURS[Reason.INLIER], opacity=0.7, thickness=int(scale))
        for picture, side, keypoints, reasons in sides:
            if picture is not None:
                _draw_side(side, keypoints, reasons, scale)
        panels += [row, np.full((_GAP, width, 3), GROUND, np.uint8)]
    points = f"{len(keypoints0)}" if len(keypoints0) == len(keypoints1) else f"{len(keypoints0)} + {len(keypoints1)}"
    summary = f"{points} points, {len(matches)} matches, {int(inliers.inlier.sum())} inliers"
    size = max(_LEAST_TEXT, round(_TEXT * width / shown_width))
    present = [reason for reason in COLOURS if np.any(np.concatenate([reasons0, reasons1]) == reason)]
    pieces = [words(name, size)] if name else []
    pieces += [words(summary, size), *(ring_key(reason.name.lower(), COLOURS[reason], size) for reason in present)]
    if len(rows) > 1:
        pieces.append(probability_key("P(inlier)", size))
    panels.append(caption(pieces, width))
    return np.concatenate(panels)


def _point_reasons(
    index: NDArray[np.int64], match_reasons: NDArray[np.uint8], known: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """(N,) `Reason` of each point: its match's, or that it has none, or that the truth about it is not known."""
    reasons = np.where(known, Reason.UNMATCHED, Reason.UNKNOWN).astype(np.uint8)
    reasons[index] = match_reasons
    return reasons


def _draw_side(panel: Picture, keypoints: Keypoints, reasons: NDArray[np.uint8], scale: float) -> None:
    """The points of one image, inliers on top of the others and better points on top of worse ones."""
    for index in np.lexsort((-np.arange(len(keypoints)), reasons == Reason.INLIER)):
        radius, score = RADIUS * scale * float(keypoints.scale[index]), float(keypoints.score[index])
        draw_point(panel, keypoints.xy[index], radius, score, COLOURS[Reason(reasons[index])], scale)
