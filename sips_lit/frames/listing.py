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
_DECIMAL = re.compile(r"(\d+)[.,](\d+)")


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
        warn_input(f"{folder}: {len(others)} files are no {kind} and are not read: {some_of(others)}")


def some_of(things: Iterable[object]) -> str:
    """The first of several, paths by their names, and how many more there are."""
    texts = [thing.name if isinstance(thing, Path) else str(thing) for thing in things]
    return ", ".join(texts[:SHOWN]) + (f" and {len(texts) - SHOWN} more" if len(texts) > SHOWN else "")


def in_order(files: Iterable[Path]) -> list[Path]:
    """The files in the order of `name_key`."""
    found = list(files)
    key = name_key([file.name for file in found])
    return sorted(found, key=lambda file: (key(file.name), file.name))


def name_key(names: Sequence[str]) -> Callable[[str], Any]:
    """A sort key for the names of the frames of one folder: runs of digits compare as numbers (img2 before img10).

    Where it makes a difference, times that were printed without trailing zeros (``1548266470.09``, ``1548266470.1``)
    compare as decimals. A fraction that begins with 0 tells them from a counter behind a point (``1.9``, ``1.10``), and so
    do seconds since 1970. Warns where a name could be either.
    """
    if sorted(names, key=_by_numbers) == sorted(names, key=_by_decimals):
        return _by_numbers
    parts = [match.groups() for name in names for match in map(_DECIMAL.fullmatch, _split(name)) if match]
    leading = any(len(fraction) > 1 and fraction.startswith("0") for _, fraction in parts)
    trailing = any(len(fraction) > 1 and fraction.endswith("0") for _, fraction in parts)
    epoch = all(len(whole) >= EPOCH_DIGITS for whole, _ in parts)
    decimal = (leading and not trailing) or (epoch and (leading or not trailing))
    if leading == trailing and not (epoch and leading):
        reading = "decimal times (1.10 before 1.9)" if decimal else "numbers behind a point (1.9 before 1.10)"
        longest = max(names, key=len)
        warn_input(f"names like {longest} can be read in two ways: taken as {reading}; rename them if that is wrong")
    return _by_decimals if decimal else _by_numbers


def natural(text: str) -> list[tuple[int, int, str]]:
    """A sort key in which runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", text)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts]


def _by_numbers(name: str) -> tuple[list[tuple[int, int, str]], str]:
    path = PurePath(name)
    return natural(path.stem), path.suffix


def _by_decimals(name: str) -> tuple[list[tuple[int, int, str]], str]:
    key = list[tuple[int, int, str]]()
    for part in _split(name):
        number = _DECIMAL.fullmatch(part)
        key += [(0, 0, ""), (1, int(number[1]), number[2]), (0, 0, "")] if number else natural(part)
    return key, PurePath(name).suffix


def _split(name: str) -> list[str]:
    """Of a name without its suffix what is text, a number, or numbers with points between them."""
    return re.split(r"(\d+(?:[.,]\d+)*)", PurePath(name).stem)
