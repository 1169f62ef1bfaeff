"""Which images of a folder, and which folders, are frames: depth maps, masks and right images are none."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from sips_lit.frames.listing import EPOCH_DIGITS

SAMPLE = 64  # files of a group that are opened, about
WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")
NUMBERS = re.compile(r"\d+")
NO_FRAMES = frozenset(
    {"depth", "depthmap", "disp", "disparity", "mask", "seg", "segmentation", "semantic", "instance"}
    | {"label", "annotation", "normal", "flow", "conf", "confidence", "gt"}
)
SECOND = frozenset({"right", "r", "ir", "infra", "infrared", "thermal", "grey", "gray"})  # beside others of one moment
CAMERA = frozenset({"cam", "camera", "c", "view", "lens", "sensor"})  # before its number
MOST_CAMERAS = 8


@dataclass(frozen=True, slots=True)
class ImageGroup:
    """Image ``files`` of one kind: ``name`` is the pattern of their names, in which * is a number, or that of their folder.

    ``bits``: how many a value has, ``colour``: whether they have colour, of each that was looked at.
    """

    name: str
    files: Sequence[Path]
    bits: frozenset[int]
    colour: frozenset[bool]
    size: tuple[int, int] | None = None

    def __str__(self) -> str:
        bits = " and ".join(f"{bits}-bit" for bits in sorted(self.bits))
        colour = " and ".join("colour" if colour else "grey" for colour in sorted(self.colour))
        return f"{len(self.files)} {self.name} ({' '.join(filter(None, (bits, colour)))})"

    @property
    def words(self) -> set[str]:
        """The words of its name, in small letters and the singular."""
        return {word.lower().removesuffix("s") for word in WORDS.findall(self.name)}

    @property
    def no_frames(self) -> bool:
        """Whether it has depth maps, masks or the like, by its name."""
        return bool(self.words & NO_FRAMES)

    @property
    def moments(self) -> set[tuple[int, ...]]:
        """The numbers in the names of its files: those at the * of the pattern, or all."""
        if "*" not in self.name:
            return {tuple(map(int, NUMBERS.findall(file.stem))) for file in self.files}
        found = map(pattern(self.name).fullmatch, (file.name for file in self.files))
        return {tuple(map(int, match.groups())) for match in found if match}


def group_of(name: str, files: Sequence[Path]) -> ImageGroup:
    """What kind of images the files are, by the headers of some of them. Files that can't be read are passed over."""
    step = (len(files) // SAMPLE) | 1  # odd: images of two kinds may alternate
    kinds = [kind for file in files[::step] if (kind := _kind(file))]
    bits, colour = frozenset(bits for bits, _, _ in kinds), frozenset(colour for _, colour, _ in kinds)
    return ImageGroup(name, files, bits, colour, kinds[0][2] if kinds else None)


def _kind(file: Path) -> tuple[int, bool, tuple[int, int]] | None:
    """Bits of a value, whether there is colour, and (W, H)."""
    try:
        with Image.open(file) as image:
            mode, size = image.mode, image.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    bits = 32 if mode == "F" else 16 if mode.startswith("I") else 8  # a picture in black and white is a grey one
    return bits, bits == 8 and mode not in ("1", "L", "LA"), size


def pattern(name: str) -> re.Pattern[str]:
    """What matches file names that have a number at each * of ``name``."""
    return re.compile(re.escape(name).replace(r"\*", r"(\d+)"))


def by_pattern(files: Sequence[Path]) -> dict[str, list[Path]]:
    """The files by the pattern of their names: each run of digits as *, but for the number of a camera, as in cam0_*.png."""
    alike: dict[str, list[Path]] = {}
    for file in files:
        alike.setdefault(NUMBERS.sub("*", file.stem) + file.suffix, []).append(file)
    return dict(group for name, own in alike.items() for group in _by_camera(name, own).items())


def _by_camera(name: str, files: list[Path]) -> dict[str, list[Path]]:
    """The files of one pattern, apart where a number in it is that of a camera, and all cameras took the same moments.

    Such a number counts from 0 or 1, and follows a word such as cam or those numbers that change: 000123_0.png.
    """
    rows = [NUMBERS.findall(file.stem) for file in files]
    texts = name.split("*")
    varying = [column for column, values in enumerate(zip(*rows, strict=True)) if len(set(values)) > 1]
    for column in varying if len(varying) > 1 else []:
        cameras = sorted({row[column] for row in rows}, key=int)
        named = (WORDS.findall(texts[column].lower()) or [""])[-1] in CAMERA
        counted = [int(camera) for camera in cameras] in ([*range(len(cameras))], [*range(1, len(cameras) + 1)])
        if len(cameras) > MOST_CAMERAS or not counted or not (named or column == varying[-1]):
            continue
        moments = [{(*row[:column], *row[column + 1 :]) for row in rows if row[column] == camera} for camera in cameras]
        if len(moments[0]) > len(cameras) and all(_shared(moments[0], other) for other in moments[1:]):
            head, tail = "*".join(texts[: column + 1]), "*".join(texts[column + 1 :])
            return {
                f"{head}{camera}{tail}": [file for file, row in zip(files, rows, strict=True) if row[column] == camera]
                for camera in cameras
            }
    return {name: files}


def without_strays(files: Sequence[Path]) -> list[Path]:
    """The images of a folder without a few such as preview.png: no other file is named alike, while most others are.

    A file with a number in its name is one only where there are ten times as many others: it may be the last frame.
    """
    alike = Counter(NUMBERS.sub("*", file.stem) for file in files)
    single = [file for file in files if alike[NUMBERS.sub("*", file.stem)] == 1]
    if 2 * len(single) >= len(files):
        return list(files)
    if len(single) > 0.1 * len(files):
        single = [file for file in single if not NUMBERS.search(file.stem)]
    return [file for file in files if file not in single]


def in_one_folder(files: Sequence[Path]) -> list[ImageGroup]:
    """Of the images of a folder those groups, by the pattern of their names, that can't be one sequence; none if all can.

    Images of 8 and 16 bits; two patterns of which one is grey and the other in colour, or one of depth maps, masks and the
    like; and two patterns with the same numbers, or with times that mix. Single grey images among coloured ones of the same
    pattern are frames. Those whose pattern is of none else are in one group, whose name has no *.
    """
    patterns = by_pattern(files)
    groups = [group_of(name, own) for name, own in patterns.items() if len(own) > 1]
    single = [own[0] for own in patterns.values() if len(own) == 1]
    groups += [group_of("others", single)] if single else []
    if _differ_in_bits(groups):
        return groups
    named = [group for group in groups if "*" in group.name]
    pairs = [(a, b) for i, a in enumerate(named) for b in named[:i]]
    apart = [(a, b) for a, b in pairs if _differ_in_colour(a, b) or a.no_frames != b.no_frames or _same_moments(a, b)]
    return [group for group in groups if any(group in pair for pair in apart)]


def in_folders(folders: Mapping[str, Sequence[Path]]) -> list[ImageGroup]:
    """The images of those of the folders, side by side, that can't all be sequences of frames; none if all can.

    Images of 8 and 16 bits; depth maps, masks and the like by the name of the folder, beside images with the same names or
    of another kind; and the same files twice, grey and in colour, or smaller (``images`` and ``images_2``).
    """
    groups = [group_of(name, own) for name, own in folders.items()]
    if _differ_in_bits(groups):
        return groups
    pairs = [(a, b) for a in groups for b in groups if a is not b]
    apart = [(a, b) for a, b in pairs if _is_no_frame_beside(a, b) or _is_smaller(a, b) or _twice(a, b)]
    return [group for group in groups if any(group in pair for pair in apart)]


def frames_among(groups: Sequence[ImageGroup]) -> list[ImageGroup]:
    """Those of groups in conflict that are the frames, by names and kinds; several or none where that can't be told."""
    left = [group for group in groups if not group.no_frames]
    left = [group for group in left if not any(_is_smaller(group, other) for other in left if other is not group)]
    eight = [group for group in left if group.bits == {8}]
    left = [group for group in eight or left if len(group.bits) == 1]
    colour = [group for group in left if True in group.colour]
    left = colour or left
    first = [group for group in left if not group.words & SECOND]
    return first or left


def _differ_in_bits(groups: Sequence[ImageGroup]) -> bool:
    return len(frozenset().union(*(group.bits for group in groups))) > 1


def _differ_in_colour(a: ImageGroup, b: ImageGroup) -> bool:
    return len(a.colour) == len(b.colour) == 1 and a.colour != b.colour


def _same_moments(a: ImageGroup, b: ImageGroup) -> bool:
    """Whether half of the files have the numbers of files of the other group, or both are times of one span."""
    moments_a, moments_b = a.moments, b.moments
    if _shared(moments_a, moments_b):
        return True
    times = all(len(str(max(moment, default=0))) >= EPOCH_DIGITS for moment in moments_a | moments_b)
    return times and min(moments_a) < max(moments_b) and min(moments_b) < max(moments_a)


def _shared(a: set[Any], b: set[Any]) -> bool:
    """Whether two, and half of the smaller set, are in both."""
    return len(a & b) >= max(2, 0.5 * min(len(a), len(b)))


def _same_names(a: ImageGroup, b: ImageGroup) -> bool:
    return _shared({file.stem for file in a.files}, {file.stem for file in b.files})


def _is_no_frame_beside(a: ImageGroup, b: ImageGroup) -> bool:
    """Whether folder ``a`` has depth maps, masks or the like of the frames of ``b``."""
    named = a.no_frames and not b.no_frames
    return named and (_differ_in_colour(a, b) or _same_names(a, b) or _same_moments(a, b))


def _is_smaller(a: ImageGroup, b: ImageGroup) -> bool:
    """Whether folder ``a``, such as images_2, has the images of ``b``, images, so many times smaller."""
    if not (found := re.fullmatch(re.escape(b.name) + r"_(\d+)", a.name)) or not (a.size and b.size):
        return False
    factor = int(found[1])
    scaled = all(abs(small * factor - large) <= factor for small, large in zip(a.size, b.size, strict=True))
    return factor > 1 and scaled and _same_names(a, b)


def _twice(a: ImageGroup, b: ImageGroup) -> bool:
    """Whether both have the same frames, one grey and one in colour: names and size agree."""
    alike = a.size == b.size and _differ_in_colour(a, b)
    return alike and {file.stem for file in a.files} == {file.stem for file in b.files}
