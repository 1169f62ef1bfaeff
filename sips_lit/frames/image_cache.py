"""Images that cost more to make than to read (rectified, corrected, resized), kept on the disk from their first use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder, write_whole
from sips_lit.frames.images import read_grey
from sips_lit.types import GreyImage


class ImageCache:
    """Images by name in ``folder``, uncompressed: reading one is little more than copying it. Without a folder: no cache.

    The folder's name should hold the fingerprint of the sequence, so that nothing stale is found in it.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def __call__(self, name: str, make: Callable[[], GreyImage]) -> GreyImage:
        """The image ``name`` (H, W), made and kept if it is not there; a damaged one is made again.

        Raises BadInputError when it can't be written, and whatever ``make`` raises.
        """
        if self.folder is None:
            return make()
        path = self.folder / f"{name}.pgm"
        try:
            return read_grey(path)
        except BadInputError:
            image = make()
        make_folder(self.folder)
        write_whole(path, cv2.imencode(".pgm", image)[1].tobytes())
        return image


def image_cache(cache_dir: str | Path | None, name: str, fingerprint: str) -> ImageCache:
    """The cache of a sequence within ``cache_dir``; None keeps nothing."""
    return ImageCache(None if cache_dir is None else Path(cache_dir) / f"{name}-{fingerprint[:8]}")
