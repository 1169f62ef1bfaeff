"""Which files of a folder are frames, and in which order."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePath
from typing import Any

from sips_lit.errors import warn_input

IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".jpe", ".jp2", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp"}
)
VIDEO_SUFFIXES = frozenset(
    {".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".m2v", ".vob", ".wmv", ".asf", ".flv", ".f4v"}
    | {".ts", ".mts", ".m2ts", ".3gp", ".3g2", ".ogv", ".mxf", ".gif", ".ivf", ".y4m", ".dv"}
    | {".mjpeg", ".mjpg", ".h264", ".264", ".h265", ".265", ".hevc"}  # raw streams
)
LEFT_BEHIND = frozenset(
    {"__MACOSX", "@eaDir", "#recycle", "$RECYCLE.BIN", "System Volume Information", "lost+found", "__pycache__"}
)
SHOWN = 4  # names in a message
EPOCH_DIGITS = 9  # of a time in seconds since 1970
_NUMBER = re.compile(r"(\D*)(\d+)(?:\.(\d+))?(\D*)")


def list_images(folder: str | Path) -> list[Path]:
    """The image files of a folder in the order of `in_order`; hidden and other files are passed over.

    Links that lead nowhere are among them: to leave them out would join the frames before and after.
    """
    return in_order(list_files(folder, IMAGE_SUFFIXES))


def list_files(folder: str | Path, suffixes: Iterable[str]) -> list[Path]:
    """The files of a folder with one of the suffixes, sorted by name; hidden ones are passed over."""
    return [file for file in visible_files(folder) if file.suffix.lower() in suffixes]


def visible_files(folder: str | Path) -> list[Path]:
    """All files of a folder but the hidden ones, sorted by name."""
    return sorted(p for p in Path(folder).iterdir() if not p.name.startswith(".") and not p.is_dir())


def list_folders(folder: str | Path) -> list[Path]:
    """The folders in a folder, sorted; hidden ones and those that systems leave behind are passed over."""
    return sorted(
        p for p in Path(folder).iterdir() if p.is_dir() and not p.name.startswith(".") and p.name not in LEFT_BEHIND
    )


def images_below(folder: Path) -> list[Path]:
    """The image files of a folder and of all folders in it, as `list_images` and `list_folders` see them."""
    return [*list_images(folder), *(image for sub in list_folders(folder) for image in images_below(sub))]


def warn_of_others(folder: Path, read: Sequence[Path], kind: str) -> None:
    """Counts and names the files of a folder that are not read as ``kind``."""
    others = sorted({file.name for file in visible_files(folder)} - {file.name for file in read})
    if others:
        more = f" and {len(others) - SHOWN} more" if len(others) > SHOWN else ""
        warn_input(f"{folder}: {len(others)} files are no {kind} and are not read: {', '.join(others[:SHOWN])}{more}")


def in_order(files: Iterable[Path]) -> list[Path]:
    """The files in the order of `name_key`."""
    found = list(files)
    key = name_key([file.name for file in found])
    return sorted(found, key=lambda file: (key(file.name), file.name))


def name_key(names: Sequence[str]) -> Callable[[str], Any]:
    """A sort key for the names of the frames of one folder: runs of digits compare as numbers (img2 before img10).

    Decimal times that were printed without trailing zeros (``1548266470.09``, ``1548266470.1``) compare as decimals. A
    fraction that begins with 0 tells them from a counter behind a point (``1.9``, ``1.10``), and so do seconds since 1970.
    Warns where a name could be either.
    """
    fractions = _fractions(names)
    if len(set(map(len, fractions))) < 2:  # also all those that are padded
        return natural
    leading = any(len(fraction) > 1 and fraction.startswith("0") for fraction in fractions)
    trailing = any(len(fraction) > 1 and fraction.endswith("0") for fraction in fractions)
    epoch = all(len(_parts(name)[1]) >= EPOCH_DIGITS for name in names)
    decimal = leading or (epoch and not trailing)
    if leading == trailing and not (epoch and not trailing):
        longest = max(names, key=len)
        reading = "decimal times (1.10 before 1.9)" if decimal else "numbers behind a point (1.9 before 1.10)"
        warn_input(f"names like {longest} can be read in two ways: taken as {reading}; rename them if that is wrong")
    return _decimal if decimal else natural


def natural(name: str) -> list[tuple[int, int, str]]:
    """A sort key in which runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts]


def _decimal(name: str) -> tuple[str, int, str, str]:
    before, whole, fraction, after = _parts(name)
    return before, int(whole), fraction.rstrip("0"), after


def _fractions(names: Sequence[str]) -> list[str]:
    """The digits behind the point of each name; nothing where the names are not all a number with the same words around."""
    matches = [_NUMBER.fullmatch(PurePath(name).stem) for name in names]
    if not all(matches) or len({(match[1], match[4]) for match in matches if match}) > 1:
        return []
    return [match[3] or "" for match in matches if match]


def _parts(name: str) -> tuple[str, str, str, str]:
    """Of a name that `_fractions` took: what stands before the number, its digits before and behind the point, the rest."""
    match = _NUMBER.fullmatch(PurePath(name).stem)
    assert match is not None
    return match[1], match[2], match[3] or "", match[4]
