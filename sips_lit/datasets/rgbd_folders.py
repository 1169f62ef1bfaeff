"""Folders of RGB-D sequences, whatever their layout: where they are, and frames without depth or pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sips_lit.datasets.layout import wrong_layout
from sips_lit.datasets.rgbd_sequence import RgbdFrames, RgbdSequence
from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.images import check_max_side
from sips_lit.frames.listing import list_folders
from sips_lit.types import ImageSequence


def sequence_folders(
    root: Path, is_sequence: Callable[[Path], bool], what: str, layout: str, levels: int = 1
) -> dict[str, Path]:
    """The folders of sequences by name: ``root`` itself, or those in it, ``levels`` deep.

    Raises BadInputError, which calls one ``what`` and says the ``layout``, where there is none.
    """
    if is_sequence(root):
        return {root.resolve().name: root}
    found, places = list[Path](), [root] if root.is_dir() else []
    for _ in range(levels):
        places = [folder for place in places for folder in list_folders(place)]
        found += [folder for folder in places if is_sequence(folder)]
    if not found:
        raise wrong_layout(f"{what} at {root}", root, layout)
    return {"_".join((root.resolve().name, *folder.relative_to(root).parts)): folder for folder in sorted(found)}


def rgbd_sequence(
    name: str, folder: Path, frames: RgbdFrames, max_side: int | None, drop_incomplete: bool = False
) -> ImageSequence:
    """The sequence of a folder; ``max_side``: shrink images (pixels).

    Warns of frames without depth or pose, and leaves them out with ``drop_incomplete``. Raises BadInputError where too few
    are left.
    """
    check_max_side(max_side)
    return RgbdSequence(folder, name, _without_incomplete(folder, frames, drop_incomplete), max_side)


def _without_incomplete(folder: Path, frames: RgbdFrames, drop: bool) -> RgbdFrames:
    """Counts the frames without depth or pose in a warning, and leaves them out if asked to."""
    depthless, poseless = (sum(part is None for part in parts) for parts in (frames.depths, frames.poses))
    if not drop and depthless == len(frames.images):  # a data set without any: nothing is missing
        depthless = 0
    if not depthless and not poseless:
        return frames
    fate = (
        "they are left out" if drop else "pairs with them have no pose and depth (data.drop_incomplete=true drops them)"
    )
    warn_input(
        f"of {len(frames.images)} images of {folder} {depthless} have no depth map and {poseless} no pose of their time: "
        f"{fate}"
    )
    if not drop:
        return frames
    parts = zip(frames.depths, frames.poses, strict=True)
    kept = [i for i, (depth, pose) in enumerate(parts) if depth is not None and pose is not None]
    if len(kept) < 2:
        raise BadInputError(f"only {len(kept)} images of {folder} have a depth map and a pose: nothing can be paired")
    return replace(
        frames,
        images=[frames.images[i] for i in kept],
        depths=[frames.depths[i] for i in kept],
        poses=[frames.poses[i] for i in kept],
        times=None if frames.times is None else [frames.times[i] for i in kept],
        cameras=None if frames.cameras is None else [frames.cameras[i] for i in kept],
    )
