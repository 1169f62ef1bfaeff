"""The frames of an image, a folder or a video, one after the other and never all in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.folder import different_kinds, images_named
from sips_lit.frames.image_kind import group_of, in_one_folder
from sips_lit.frames.images import read_grey, read_rgb, read_values
from sips_lit.frames.listing import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_images
from sips_lit.frames.span import find_span
from sips_lit.frames.video_file import VideoFile
from sips_lit.types import GreyImage

DEFAULT_FPS: Final = 25.0
"""Frames a second of a video that does not say."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image: ``name`` is what its output files are called, ``grey`` (H, W) is what detectors see.

    ``picture`` is what people see: RGB (H, W, 3), or the grey image unless colour was asked for. ``file`` is the name of the
    image's file, empty for a frame of a video.
    """

    name: str
    grey: GreyImage
    picture: NDArray[np.uint8]
    file: str = ""


class FrameStream(ABC):
    """Iterates over frames. ``total`` is how many there should be, None if unknown; ``fps`` is None for images."""

    total: int | None
    fps: float | None

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]: ...


def open_stream(path: Path, colour: bool, names: str | None = None) -> FrameStream:
    """The frames of an image, of the images in a folder, or of a video; ``colour`` asks for RGB pictures of them.

    ``names``: of a folder only the images with such names, in which * is a number. Raises BadInputError when there is
    nothing to read there, and where depth maps or masks lie among the images.
    """
    if path.is_dir():
        images = list_images(path)
        if not images:
            raise BadInputError(f"the folder {path} holds no images: give a folder of images, one image, or a video")
        if names is not None:
            return ImageStream(images_named(path, images, names, "names"), colour)
        conflict = in_one_folder(images)
        numbered = [group for group in conflict if "*" in group.name]  # others are images that need not be alike
        if any(group.no_frames for group in numbered) or len({bits for group in numbered for bits in group.bits}) > 1:
            raise different_kinds(path, conflict, "names")
        return ImageStream(images, colour)
    if not path.is_file():
        raise BadInputError(f"there is no {path}: give an image, a folder of images, or a video")
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return ImageStream([path], colour)
    try:
        return VideoStream(path)
    except BadInputError as error:
        if path.suffix.lower() in VIDEO_SUFFIXES:
            raise
        raise BadInputError(f"{path} is neither an image nor a video that can be read: check the file") from error


class ImageStream(FrameStream):
    """Image files, named by their stems. Sizes may differ.

    Raises BadInputError when two stems are equal, and, while iterating, at the first file that cannot be read.
    """

    def __init__(self, paths: Sequence[Path], colour: bool) -> None:
        stem, count = Counter(path.stem for path in paths).most_common(1)[0]
        if count > 1:
            same = ", ".join(path.name for path in paths if path.stem == stem)
            raise BadInputError(
                f"{same} in {paths[0].parent} would give output files of the same name: rename or move one"
            )
        self.paths, self.colour = paths, colour
        self.total, self.fps = len(paths), None

    def __iter__(self) -> Iterator[Frame]:
        deep = [path for path in self.paths if group_of(path.name, [path]).bits == {16}]
        span = find_span(len(deep), lambda index: read_values(deep[index]))
        for path in self.paths:
            grey = read_grey(path, span)  # also finds damaged files
            yield Frame(path.stem, grey, read_rgb(path, grey) if self.colour else grey, path.name)


class VideoStream(FrameStream):
    """Decodes a video frame by frame; frame i is named ``<stem>_<i, six digits>``.

    ``fps`` is `DEFAULT_FPS` if the video does not say. Raises BadInputError when it cannot be decoded.
    """

    def __init__(self, path: Path) -> None:
        self.video = VideoFile(path)
        self.fps, self.total = self.video.fps or DEFAULT_FPS, self.video.total

    def __iter__(self) -> Iterator[Frame]:
        for index, frame in enumerate(self.video):
            grey = frame.grey(self.video.span)
            picture = np.dstack([grey] * 3) if frame.deep else cv2.cvtColor(frame.colour(), cv2.COLOR_BGR2RGB)
            yield Frame(f"{self.video.path.stem}_{index:06d}", grey, np.asarray(picture, np.uint8))
        if self.video.damage:
            warn_input(self.video.damage)
