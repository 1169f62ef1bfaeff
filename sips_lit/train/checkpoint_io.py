"""Checkpoints of a run as files: written whole, with the one before kept, which serves where the last is damaged."""

from __future__ import annotations

import io
import os
import shutil
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO

from sips_lit.detect.checkpoint import is_sound
from sips_lit.errors import BadInputError, warn_input
from sips_lit.files import make_folder, unwritten, write_whole


class WholeCheckpointIO(TorchCheckpointIO):
    """Writes a checkpoint beside its place, to the disk, and only then under its name; keeps the one that was there.

    Lightning's own writer goes through the temporary folder: if that is on another disk, it empties the old file and
    copies into it, and a kill or a full disk leaves nothing.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        """Raises BadInputError when it cannot be written; what was there before is there still."""
        path, content = Path(path), io.BytesIO()
        torch.save(checkpoint, content)
        make_folder(path.parent)
        _clear_up(path)
        new = path.with_name(f"{path.name}.new")
        try:
            write_whole(new, content.getbuffer())
            _keep(path)
            new.replace(path)
        except OSError as error:
            raise BadInputError(unwritten(path, error)) from error
        finally:
            new.unlink(missing_ok=True)


def previous_of(path: Path) -> Path:
    """Where the checkpoint is kept that was written before this one."""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def sound_checkpoint(path: Path) -> Path:
    """The checkpoint itself, or the one before it, with a warning, where it is damaged and the other is not."""
    previous = previous_of(path)
    if is_sound(path) or not is_sound(previous):
        return path
    warn_input(f"{path} is damaged: going on from the checkpoint before it, {previous}")
    return previous


def _keep(path: Path) -> None:
    """Gives the checkpoint that is about to be replaced a second name, if it is sound."""
    if not is_sound(path):
        return
    second = path.with_name(f".{path.name}.old")
    try:
        os.link(path, second)
    except OSError:  # a file system without hard links
        shutil.copyfile(path, second)
    second.replace(previous_of(path))
    second.unlink(missing_ok=True)  # renaming leaves it where both are one file already


def _clear_up(path: Path) -> None:
    """Removes what a killed run left of a checkpoint that it was writing."""
    for file in path.parent.iterdir():
        if file.name.startswith(f".{path.name}."):
            file.unlink(missing_ok=True)
