"""Videos as a data set: no truth but the images."""

from __future__ import annotations

from pathlib import Path

from sips_lit.datasets.spec import DatasetSpec
from sips_lit.errors import BadInputError
from sips_lit.frames.listing import VIDEO_SUFFIXES
from sips_lit.frames.video import find_videos, video


def count_videos(path: Path) -> str | None:
    """The sign: the name of a video file, or how many a folder has."""
    if path.is_file():
        return path.name if path.suffix.lower() in VIDEO_SUFFIXES else None
    try:
        count = len(find_videos(path))
    except BadInputError:
        return None
    return f"{count} video{'s' * (count > 1)}"


SPEC = DatasetSpec(kind="video", title="video", loader=video, signs=(count_videos,), rank=1, videos=find_videos)
