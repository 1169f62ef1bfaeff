"""Features and matches as COLMAP takes them: its database, and the text files of its feature importer.

COLMAP calls the centre of the first pixel (0.5, 0.5): half a pixel is added here and nowhere else. It matches SIFT
descriptors of 128 bytes; others go into no file of COLMAP, but matches of theirs do.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.files import FULL, Unfinished, make_folder, unwritten, write_whole
from sips_lit.types import Keypoints, Matches

HALF_PIXEL: Final = np.float32(0.5)
LENGTH: Final = 512  # of a SIFT descriptor in bytes, about
SIMPLE_RADIAL: Final = 2  # COLMAP's number of the camera model f, cx, cy, k
FOCAL: Final = 1.2  # times the longer side: what COLMAP assumes of a camera that it knows nothing of
PAIR_FACTOR: Final = 2**31 - 1
# That of COLMAP 3, to which newer versions add columns and tables when they open it; older ones read no newer.
SCHEMA: Final = """
CREATE TABLE cameras (
    camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL, width INTEGER NOT NULL,
    height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (
    image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
    prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL, prior_ty REAL, prior_tz REAL,
    CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (
    image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (
    image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (
    pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (
    pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
    config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
"""


class ColmapDatabase:
    """Writes a database of COLMAP, new; the file has its name after `close`.

    Images of one size share a camera, of which nothing is known but what COLMAP assumes itself.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises BadInputError where the file can't be written."""
        self.path = Path(path)
        self._whole = Unfinished(self.path)
        self._cameras: dict[tuple[int, int], int] = {}
        self._ids: dict[str, int] = {}
        self._open = True
        self._whole.discard()  # of a run that was killed: SQLite would go on with it
        try:
            self._sql = sqlite3.connect(self._whole.temporary, isolation_level=None)
        except sqlite3.Error as error:
            raise BadInputError(unwritten(self.path, OSError(None, str(error)))) from error
        with self._told():
            self._sql.execute("PRAGMA journal_mode = OFF")  # a file that is not whole is removed anyhow
            self._sql.executescript(SCHEMA)
            self._sql.execute("BEGIN")

    @property
    def images(self) -> int:
        """How many there are."""
        return len(self._ids)

    def add(
        self, name: str, size: tuple[int, int], keypoints: Keypoints, descriptors: NDArray[Any] | None = None
    ) -> None:
        """Adds an image: its name, size (W, H), N points and their descriptors (N, 128).

        Raises BadInputError for a name that is there, descriptors that are not SIFT's, and where the disk is full.
        """
        if name in self._ids:
            raise BadInputError(f"{self.path} has the image {name} already: give every image a name of its own")
        data = None if descriptors is None else sift_bytes(descriptors)
        with self._told():
            insert = "INSERT INTO images (name, camera_id) VALUES (?, ?)"
            number = self._sql.execute(insert, (name, self._camera(size))).lastrowid
            assert number is not None
            self._ids[name] = number
            for table, array in (("keypoints", colmap_keypoints(keypoints)), ("descriptors", data)):
                if array is not None:
                    self._sql.execute(
                        f"INSERT INTO {table} VALUES (?, ?, ?, ?)", (number, *array.shape, array.tobytes())
                    )

    def add_matches(self, name0: str, name1: str, matches: Matches) -> None:
        """Adds the matches of two images, for COLMAP to verify.

        Raises BadInputError for an image that is not there, and for a pair that has matches.
        """
        missing = next((name for name in (name0, name1) if name not in self._ids), None)
        if missing is not None:
            raise BadInputError(f"{self.path} has no image {missing}: add it before its matches")
        first, second = self._ids[name0], self._ids[name1]
        columns = [matches.index0, matches.index1] if first < second else [matches.index1, matches.index0]
        array = np.stack(columns, axis=1).astype(np.uint32)
        pair = min(first, second) * PAIR_FACTOR + max(first, second)
        if self._sql.execute("SELECT 1 FROM matches WHERE pair_id = ?", (pair,)).fetchone():
            raise BadInputError(f"{self.path} has matches of {name0} and {name1} already: add them once")
        with self._told():
            self._sql.execute("INSERT INTO matches VALUES (?, ?, ?, ?)", (pair, *array.shape, array.tobytes()))

    def close(self) -> None:
        """Finishes the file, of the images so far. Raises BadInputError where they do not fit on the disk."""
        if not self._open:
            return
        with self._told():
            self._sql.execute("COMMIT")
        self._open = False
        self._sql.close()
        self._whole.finish()

    def __enter__(self) -> ColmapDatabase:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _camera(self, size: tuple[int, int]) -> int:
        if size not in self._cameras:
            width, height = size
            params = np.array([FOCAL * max(size), width / 2, height / 2, 0.0])
            insert = "INSERT INTO cameras (model, width, height, params, prior_focal_length) VALUES (?, ?, ?, ?, 0)"
            number = self._sql.execute(insert, (SIMPLE_RADIAL, width, height, params.tobytes())).lastrowid
            assert number is not None
            self._cameras[size] = number
        return self._cameras[size]

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Errors of SQLite in the words of other files, and no half of a file left."""
        try:
            yield
        except sqlite3.Error as error:
            self._open = False
            self._sql.close()
            self._whole.discard()
            full = getattr(error, "sqlite_errorname", "") == "SQLITE_FULL"
            cause = OSError(FULL[0] if full else None, str(error))
            raise BadInputError(unwritten(self.path, cause)) from error


class ColmapText:
    """Writes ``<image>.txt`` for COLMAP's ``feature_importer``: x, y, scale, orientation and 128 bytes a point."""

    def __init__(self, path: str | Path) -> None:
        """``path`` is the folder. Raises BadInputError where it can't be made."""
        self.path, self.images = Path(path), 0
        make_folder(self.path)

    def add(
        self, name: str, size: tuple[int, int], keypoints: Keypoints, descriptors: NDArray[Any] | None = None
    ) -> None:
        """Writes the file of an image. Raises BadInputError where it can't, and for descriptors that are not SIFT's."""
        if descriptors is None:
            raise BadInputError("COLMAP's text has descriptors of all points: choose descriptor=rootsift or sift")
        rows = zip(colmap_keypoints(keypoints), sift_bytes(descriptors), strict=True)
        lines = [" ".join(map(str, [*point, *data])) for point, data in rows]
        path = self.path / f"{name}.txt"
        make_folder(path.parent)
        write_whole(path, "".join(f"{line}\n" for line in [f"{len(lines)} 128", *lines]).encode())
        self.images += 1

    def close(self) -> None:
        """Nothing is open."""


def colmap_keypoints(keypoints: Keypoints) -> NDArray[np.float32]:
    """x, y, scale and orientation (N, 4) float32 in COLMAP's pixels; all are upright."""
    zero = np.zeros(len(keypoints), np.float32)
    return np.column_stack([keypoints.xy + HALF_PIXEL, keypoints.scale, zero]).astype(np.float32)


def sift_bytes(descriptors: NDArray[Any]) -> NDArray[np.uint8]:
    """SIFT or RootSIFT descriptors (N, 128) as bytes, of length 512. Raises BadInputError for others."""
    is_float = descriptors.dtype.kind == "f"
    if not is_float or descriptors.shape[1:] != (128,) or (descriptors.size and descriptors.min() < 0):
        raise BadInputError(
            f"COLMAP matches SIFT descriptors of 128 values that are not negative, not {descriptors.dtype} ones of shape "
            f"{descriptors.shape}: choose descriptor=rootsift or sift, or own (none) and add matches of your own"
        )
    unit = not descriptors.size or descriptors.max() <= 1  # else they are bytes already, as OpenCV gives them
    return np.asarray(np.clip(np.rint(descriptors * (LENGTH if unit else 1)), 0, 255), np.uint8)
