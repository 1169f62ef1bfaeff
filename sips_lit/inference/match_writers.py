"""Where matches go: npz, tables, pictures. A file has its name when it is whole."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final, Literal, Protocol

import cv2
import numpy as np

from sips_lit.files import make_folder, write_whole
from sips_lit.inference.csv_table import CsvTable
from sips_lit.inference.match_stream import NamedPair
from sips_lit.inference.matched_pair import MatchedPair

MatchFormat = Literal["npz", "csv", "picture"]
_MODEL: Final = [f"m{row}{column}" for row in range(3) for column in range(4)]


class MatchWriter(Protocol):
    """Takes one pair after the other."""

    @property
    def written(self) -> str:
        """What was written so far, in words."""

    def write(self, named: NamedPair) -> None:
        """Writes a pair. Raises BadInputError when that is not possible."""

    def close(self) -> None:
        """Ends the output, where something is open; also called after an error."""
        return


def open_match_writer(kind: MatchFormat, folder: Path) -> MatchWriter:
    """The writer of one output format."""
    match kind:
        case "npz":
            return NpzMatchWriter(folder)
        case "csv":
            return CsvMatchWriter(folder)
        case "picture":
            return PictureMatchWriter(folder)


class NpzMatchWriter(MatchWriter):
    """``<pair>.npz``: ``xy0``, ``xy1`` (M, 2), ``confidence``, ``inlier`` (M,), ``image_size0``, ``image_size1`` (W, H).

    And ``homography`` (3, 3) or ``T_1_0`` (4, 4) where there is one.
    """

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder, self.files = folder, 0

    @property
    def written(self) -> str:
        """What was written so far."""
        return "1 npz file" if self.files == 1 else f"{self.files} npz files"

    def write(self, named: NamedPair) -> None:
        """Writes one file."""
        pair, buffer = named.pair, io.BytesIO()
        content: dict[str, Any] = {key: getattr(pair, key) for key in ("xy0", "xy1", "confidence", "inlier")}
        models = {"homography": pair.homography, "T_1_0": pair.T_1_0}
        content |= {key: value for key, value in models.items() if value is not None}
        content |= {f"image_size{i}": np.array(image.shape[::-1]) for i, image in enumerate((pair.image0, pair.image1))}
        np.savez(buffer, **content)
        write_whole(self.folder / f"{named.name}.npz", buffer.getvalue())
        self.files += 1


class CsvMatchWriter(MatchWriter):
    """``matches.csv``, a row a match, and ``pairs.csv``, a row a pair with its counts and its model as numbers.

    Those are of the homography, h00 to h22, or the first three rows of ``T_1_0``, m00 to m23; empty where there is none.
    """

    def __init__(self, folder: Path) -> None:
        self.matches, self.pairs = CsvTable(folder / "matches.csv"), CsvTable(folder / "pairs.csv")
        self.rows, self.count = 0, 0
        self.matches.append([["pair", "x0", "y0", "x1", "y1", "confidence", "inlier"]])

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"matches.csv ({self.rows} rows), pairs.csv ({self.count} rows)"

    def write(self, named: NamedPair) -> None:
        """Appends the rows of a pair."""
        pair = named.pair
        if not self.count:
            self.pairs.append([["pair", "points0", "points1", "matches", "inliers", "model", *_columns(pair)]])
        numbers = np.column_stack([pair.xy0, pair.xy1, pair.confidence])
        rows = zip(numbers, pair.inlier, strict=True)
        self.matches.append([named.name, *map(str, row), int(inlier)] for row, inlier in rows)
        counts = len(pair.keypoints0), len(pair.keypoints1), len(pair), int(pair.inlier.sum())
        self.pairs.append([[named.name, *counts, pair.model, *_numbers(pair)]])
        self.rows, self.count = self.rows + len(pair), self.count + 1

    def close(self) -> None:
        """Finishes both tables, of the pairs so far."""
        self.matches.close()
        self.pairs.close()


class PictureMatchWriter(MatchWriter):
    """``<pair>.png``: `MatchedPair.picture`."""

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder, self.files = folder, 0

    @property
    def written(self) -> str:
        """What was written so far."""
        return "1 picture" if self.files == 1 else f"{self.files} pictures"

    def write(self, named: NamedPair) -> None:
        """Writes one picture."""
        picture = cv2.cvtColor(named.pair.picture(name=named.name), cv2.COLOR_RGB2BGR)
        write_whole(self.folder / f"{named.name}.png", cv2.imencode(".png", picture)[1].tobytes())
        self.files += 1


def _columns(pair: MatchedPair) -> list[str]:
    if pair.posed:
        return _MODEL
    return [f"h{row}{column}" for row in range(3) for column in range(3)]


def _numbers(pair: MatchedPair) -> list[str]:
    """The model, row by row."""
    model = pair.homography if pair.T_1_0 is None else pair.T_1_0[:3]
    return [""] * len(_columns(pair)) if model is None else [str(value) for value in model.ravel()]
