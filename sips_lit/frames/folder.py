"""A folder of images as a sequence."""

from __future__ import annotations

import functools
import hashlib
import shlex
from collections.abc import Sequence
from pathlib import Path

from sips_lit.errors import BadInputError, warn_input
from sips_lit.files import safe_name
from sips_lit.frames.image_kind import (
    ImageGroup,
    by_pattern,
    frames_among,
    in_folders,
    in_one_folder,
    pattern,
    without_strays,
)
from sips_lit.frames.images import GREY_VERSION, check_max_side, read_grey, read_values, resize_max_side
from sips_lit.frames.listing import SHOWN, list_folders, list_images, some_of, warn_of_others
from sips_lit.frames.span import Span, find_span
from sips_lit.types import GreyImage, ImageSequence


class FolderSequence(ImageSequence):
    """The images of one folder in the order of their names, all of one size."""

    def __init__(
        self, folder: Path, files: Sequence[Path], max_side: int | None = None, name: str | None = None
    ) -> None:
        self.folder, self.files, self.max_side = folder, list(files), max_side
        self.name = safe_name(name or folder.resolve().name)
        stats = [(file.name, *_size_and_time(file)) for file in self.files]
        self.fingerprint = hashlib.sha256(repr((stats, max_side, GREY_VERSION)).encode()).hexdigest()[:16]
        self._size: tuple[int, int] | None = None

    def __len__(self) -> int:
        return len(self.files)

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``. Raises BadInputError when it can't be read or is not of the size of the first one that can."""
        image = read_grey(self.files[index], self.span)
        height, width = image.shape
        if index == 0:
            self._size = (width, height)
        if (width, height) != self.size:
            raise BadInputError(
                f"{self.files[index]} is {width}x{height}, but {self._first.name} is {self.size[0]}x{self.size[1]}: the "
                "images of a sequence must have one size; put others in another folder"
            )
        return resize_max_side(image, self.max_side)

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the files in pixels, before they are shrunk. Raises BadInputError when none can be read."""
        if self._size is None:
            height, width = read_values(self._first).shape[:2]
            self._size = (width, height)
        return self._size

    @functools.cached_property
    def span(self) -> Span:
        """Which 16-bit values become 0 to 255: one span for all images."""
        return find_span(len(self), lambda index: read_values(self.files[index]))

    @functools.cached_property
    def _first(self) -> Path:
        """The first file that can be read; the first of all if none can."""
        return next((file for file in self.files if _can_be_read(file)), self.files[0])

    def notes(self) -> list[str]:
        """Which values of 16-bit images are used."""
        return self.span.notes()

    def frame_name(self, index: int) -> str:
        """The file's name without its suffix."""
        return self.files[index].stem


def folder(
    path: str | Path | Sequence[str | Path], max_side: int | None = None, names: str | None = None
) -> list[ImageSequence]:
    """Sequences of a folder of images, of a folder of such folders, or of a list of folders.

    Where a folder has images and folders of images, those that are more are read, with a warning of the others.
    ``max_side``: shrink images whose longer side exceeds it (pixels); ``names``: read only images with such a name, in
    which * is a number. Raises BadInputError when a folder is missing, has fewer than two images, or images that differ in
    kind, such as colour and depth; folders in a list are taken as they are.
    """
    check_max_side(max_side)
    if isinstance(path, str | Path):
        return _with_unique_names(_sequences(Path(path), max_side, names))
    sequences = [sequence for part in path for sequence in _sequences(Path(part), max_side, names)]
    if not sequences:
        raise BadInputError("the list of folders is empty: data.path must name one folder of images at least")
    return _with_unique_names(sequences)


def names_of_frames(folder: Path) -> str | None:
    """What ``names`` must be where the images of a folder differ in kind and their names tell the frames; else None."""
    conflict = in_one_folder(without_strays(list_images(folder)))
    frames = frames_among(conflict)
    return frames[0].name if len(frames) == 1 and "*" in frames[0].name and len(conflict) > 1 else None


def _size_and_time(file: Path) -> tuple[int, int]:
    """Bytes and time of change in nanoseconds; zeros for a link that leads nowhere."""
    try:
        stat = file.stat()
    except OSError:
        return 0, 0
    return stat.st_size, stat.st_mtime_ns


def _can_be_read(file: Path) -> bool:
    try:
        read_values(file)
    except BadInputError:
        return False
    return True


def _sequences(root: Path, max_side: int | None, names: str | None) -> list[ImageSequence]:
    if not root.is_dir():
        problem = f"{root} is a file" if root.exists() else f"there is no folder {root}"
        raise BadInputError(f"{problem}: data.path must be a folder of images")
    images = list_images(root)
    below = {sub: own for sub in list_folders(root) if (own := list_images(sub))}
    if images and len(images) >= max(map(len, below.values()), default=0):
        if below:
            warn_input(f"{root}: its own images are read, those in {some_of(below)} are not")
        return [_sequence(root, _frames(root, images, names), max_side, root.resolve().name)]
    if not below:
        raise BadInputError(f"the folder {root} has no images (.png, .jpg, ...), nor have its subfolders")
    if images:
        warn_input(f"{root}: the images in its folders are read, its own are not: {some_of(images)}")
    single = [sub for sub, own in below.items() if len(own) == 1]
    if single and len(single) < len(below):
        warn_input(f"{root}: folders of one image make no pair and are not read: {some_of(single)}")
        below = {sub: own for sub, own in below.items() if sub not in single}
    frames = {sub: _frames(sub, own, names) for sub, own in below.items()}
    conflict = in_folders({sub.name: own for sub, own in frames.items()})
    if conflict:
        choices = [shlex.quote(f"data.path={root / group.name}") for group in frames_among(conflict) or conflict]
        raise BadInputError(
            f"the folders of {root} hold images of different kinds, {some_of(conflict)}: give the one with the frames, "
            f"{' or '.join(choices[:SHOWN])}, or a list of folders; sips-data check {root} tells which data= reads depth "
            "and poses"
        )
    return [_sequence(sub, own, max_side, f"{root.resolve().name}_{sub.name}") for sub, own in frames.items()]


def _frames(root: Path, images: Sequence[Path], names: str | None) -> list[Path]:
    """The images of a folder that are frames. Raises BadInputError where that is not clear."""
    if names is not None:
        frames = images_named(root, images, names)
    else:
        frames = without_strays(images)
        conflict = in_one_folder(frames)
        if conflict:
            raise different_kinds(root, conflict, "data.names")
    warn_of_others(root, frames, "frames")
    return frames


def images_named(root: Path, images: Sequence[Path], names: str, key: str = "data.names") -> list[Path]:
    """The images of a folder with such names, in which * is a number. Raises BadInputError without any."""
    found = [file for file in images if pattern(names).fullmatch(file.name)]
    if not found:
        raise BadInputError(
            f"{root} has no images named {names} ({key}, where * is a number), but {some_of(by_pattern(images))}"
        )
    return found


def different_kinds(root: Path, conflict: Sequence[ImageGroup], key: str) -> BadInputError:
    """The error for a folder with groups of images in conflict: the choices are values of ``key``."""
    named = [shlex.quote(f"{key}={group.name}") for group in frames_among(conflict) or conflict if "*" in group.name]
    way = f"set {' or '.join(named[:SHOWN])} to read these alone, or " if len(conflict) > 1 and named else ""
    return BadInputError(
        f"{root} has images of different kinds, {some_of(conflict)}: {way}put each kind into a folder of its own; "
        f"sips-data check {root} tells which data= reads depth and poses"
    )


def _sequence(folder: Path, files: list[Path], max_side: int | None, name: str) -> ImageSequence:
    if len(files) < 2:
        raise BadInputError(
            f"the folder {folder} has one image only: a sequence needs two or more of one moving camera"
        )
    return FolderSequence(folder, files, max_side, name)


def _with_unique_names(sequences: list[ImageSequence]) -> list[ImageSequence]:
    names: set[str] = set()
    for sequence in sequences:
        wanted, count = sequence.name, 1
        while sequence.name in names:
            count += 1
            sequence.name = f"{wanted}_{count}"
        names.add(sequence.name)
    return sequences
