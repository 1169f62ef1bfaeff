"""Features in hloc's h5: a group an image, named by its path below the folder of the images."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError, import_extra
from sips_lit.files import Unfinished, unwritten
from sips_lit.types import Keypoints


class HlocFeatures:
    """Writes ``keypoints`` (N, 2), ``scores`` (N,), ``scales`` (N,), ``descriptors`` (D, N) and ``image_size`` (W, H).

    The file has its name after `close`; `sips_lit.baselines.precomputed` and hloc's matchers read it.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises BadInputError where h5py is missing or the file can't be written."""
        h5py = import_extra("h5py", "formats", "hloc's h5")
        self.path, self.images = Path(path), 0
        self._whole = Unfinished(self.path)
        try:
            self._bytes = _File(self._whole.temporary)
            self._file: Any = h5py.File(self._bytes, "w")
        except OSError as error:
            raise BadInputError(unwritten(self.path, error)) from error

    def add(
        self, name: str, size: tuple[int, int], keypoints: Keypoints, descriptors: NDArray[Any] | None = None
    ) -> None:
        """Adds an image: its name, size (W, H), N points and their descriptors (N, D).

        Raises BadInputError for a name that is there, and where the disk is full.
        """
        if name in self._file:
            raise BadInputError(f"{self.path} has features of {name} already: give every image a name of its own")
        held = {"keypoints": keypoints.xy, "scores": keypoints.score, "scales": keypoints.scale}
        group = self._file.create_group(name)
        for key, values in held.items():
            group[key] = values
        if descriptors is not None:
            group["descriptors"] = descriptors.T
        group["image_size"] = np.array(size, np.int64)
        self._file.flush()
        self._check()
        self.images += 1

    def close(self) -> None:
        """Finishes the file, of the images so far. Raises BadInputError where they do not fit on the disk."""
        if self._bytes.closed:
            return
        self._file.close()
        self._check()
        self._bytes.close()
        self._whole.finish()

    def __enter__(self) -> HlocFeatures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check(self) -> None:
        if self._bytes.error is not None:
            error = self._bytes.error
            self._file.close()
            self._bytes.close()
            self._whole.discard()
            raise BadInputError(unwritten(self.path, error)) from error


class _File(io.FileIO):
    """Keeps the first error of writing for later: HDF5 2.0 crashes the process if a write fails."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """The whole of ``data``, or nothing more once the disk is full."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        while len(rest) and self.error is None:
            try:
                rest = rest[super().write(rest) :]
            except OSError as error:
                self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Makes the file longer or shorter."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0
