"""Folders of images as a data set: no truth but the images."""

from __future__ import annotations

from pathlib import Path

from sips_lit.datasets.spec import DatasetSpec
from sips_lit.frames.folder import folder
from sips_lit.frames.listing import list_images


def count_images(path: Path) -> str | None:
    """The sign: how many images a folder has."""
    count = len(list_images(path)) if path.is_dir() else 0
    return f"{count} images" if count else None


SPEC = DatasetSpec(kind="folder", title="folder of images", loader=folder, signs=(count_images,), rank=2, family=True)
