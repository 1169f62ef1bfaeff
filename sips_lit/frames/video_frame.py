"""A decoded frame of a video, as an array: upright, in colour, grey, or with all its bits."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, cast

import av
import numpy as np
from av.sidedata.sidedata import Type as SideDataType
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from sips_lit.frames.images import to_grey
from sips_lit.frames.span import Span
from sips_lit.types import GreyImage


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """A decoded frame; ``after_hole``: frames between it and the one before it could not be decoded.

    ``reformatter`` is shared by the frames of a video: to make one takes longer than to use it.
    """

    decoded: av.VideoFrame
    after_hole: bool
    reformatter: VideoReformatter

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) in pixels, upright."""
        width, height = self.decoded.width, self.decoded.height
        return (height, width) if self._matrix[2] else (width, height)

    def colour(self) -> NDArray[np.uint8]:
        """BGR (H, W, 3) as OpenCV decodes it, turned and mirrored as the file says."""
        return np.asarray(self._upright(self._as("bgr24")), np.uint8)

    @property
    def deep(self) -> bool:
        """Whether it is grey of more than 8 bits, as of thermal cameras."""
        form = self.decoded.format
        return form.name.startswith("gray") and form.components[0].bits > 8

    def values(self) -> NDArray[Any]:
        """BGR as `colour` gives it; of a deep grey frame its 16-bit values (H, W), scaled by the decoder to all 16 bits."""
        if not self.deep:
            return self.colour()
        return self._upright(self._as("gray16le"))

    def grey(self, span: Span) -> GreyImage:
        """Grey (H, W), upright; deep values are scaled by ``span``."""
        return to_grey(self.values(), "a frame", span)

    def _as(self, form: str) -> NDArray[Any]:
        converted = self.reformatter.reformat(self.decoded, format=form, interpolation="BICUBIC")  # as OpenCV has it
        return converted.to_ndarray()

    def _upright(self, image: NDArray[Any]) -> NDArray[Any]:
        x, y, across = self._matrix
        image = image.swapaxes(0, 1) if across else image
        return np.ascontiguousarray(image[:: -1 if y < 0 else 1, :: -1 if x < 0 else 1])

    @property
    def _matrix(self) -> tuple[int, int, bool]:
        """How the display matrix turns and mirrors: the signs of x and y, after they are swapped or not."""
        given = cast(Any, self.decoded.side_data).get(SideDataType.DISPLAYMATRIX)
        a, b, _, c, d = struct.unpack("5i", bytes(given)[:20]) if given else (1, 0, 0, 0, 1)
        return (c, b, True) if abs(b) > abs(a) else (a, d, False)
