"""Flights over given photographs, one plane each or layers of several."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from sips_lit.datasets.layered_flight import LayeredFlight
from sips_lit.datasets.plane_flight import VirtualFlight
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import list_images
from sips_lit.types import GreyImage, ImageSequence


def virtual_flight(
    path: str | Path,
    size: tuple[int, int] = (480, 360),
    length: int = 80,
    flights_per_still: int = 4,
    seed: int = 0,
    layers: int = 0,
) -> list[ImageSequence]:
    """Flights over the photograph ``path``, or all those of a folder. See `flights_over`.

    Raises BadInputError when there is no photograph.
    """
    path = Path(path)
    if not path.exists():
        raise BadInputError(f"there is no image or folder {path} to fly over: set data.path")
    files = list_images(path) if path.is_dir() else [path]
    stems = Counter(file.stem for file in files)
    names = [file.stem if stems[file.stem] == 1 else file.name for file in files]
    stills = [(safe_name(name), read_grey(file)) for name, file in zip(names, files, strict=True)]
    return flights_over(stills, size, length, flights_per_still, seed, layers)


def flights_over(
    stills: Sequence[tuple[str, GreyImage]],
    size: tuple[int, int] = (480, 360),
    length: int = 80,
    flights_per_still: int = 4,
    seed: int = 0,
    layers: int = 0,
) -> list[ImageSequence]:
    """``flights_per_still`` flights over each (name, photograph): ``length`` frames of ``size`` (W, H).

    With ``layers``, pieces of so many of the photographs at most are afloat above each: see `LayeredFlight`.

    Raises BadInputError when there is no photograph, one is too small to fly over, or a number is out of range.
    """
    width, height = (int(side) for side in size)
    if min(width, height) < 16 or length < 2 or flights_per_still < 1 or min(seed, layers) < 0:
        raise BadInputError(
            "flights need a size of at least 16x16, length >= 2, flights_per_still >= 1, seed >= 0 and layers "
            f">= 0, not {width}x{height}, {length}, {flights_per_still}, {seed} and {layers}"
        )
    if not stills:
        raise BadInputError("there are no photographs to fly over: give an image, or a folder of images")
    for name, still in stills:
        if min(still.shape) < 32:
            raise BadInputError(f"the photograph {name} is {still.shape[1]}x{still.shape[0]}: too small to fly over")
    flights: list[ImageSequence] = []
    for name, still in stills:
        others = [other for another, other in stills if another != name] or [still]
        for flight in range(flights_per_still):
            arguments = still, name, (width, height), length, seed, flight
            flights.append(LayeredFlight(*arguments, layers, others) if layers else VirtualFlight(*arguments))
    return flights
