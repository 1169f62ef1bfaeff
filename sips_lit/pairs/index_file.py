"""The file of an overlap index: written whole, and read only if it was made from these frames with these parameters."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sips_lit.files import make_folder, write_whole
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.types import ImageSequence


def index_path(folder: Path, sequence: ImageSequence) -> Path:
    """Where the index of a sequence is stored."""
    digest = hashlib.sha256(f"{sequence.name}|{sequence.fingerprint}".encode()).hexdigest()[:8]
    return folder / f"{sequence.name}-{digest}.overlap.npz"


def save_index(path: Path, index: OverlapIndex, signature: Mapping[str, Any]) -> None:
    """Writes an index atomically: a reader sees the old file or the new one, never half of one.

    Raises BadInputError when the folder can't be written (full disk, no permission).
    """
    content, text = io.BytesIO(), np.array(json.dumps(signature, sort_keys=True))
    why = np.array(json.dumps({str(frame): reason for frame, reason in index.unreadable.items()}))
    np.savez(
        content,
        survivors=index.survivors,
        motion=index.motion,
        offsets=index.offsets,
        points=index.points,
        unreadable=why,
        signature=text,
    )
    make_folder(path.parent)
    write_whole(path, content.getvalue())


def load_index(path: Path, signature: Mapping[str, Any]) -> OverlapIndex | None:
    """The stored index, or None if there is none, it is damaged, or it was made from other frames or parameters."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            if json.loads(str(stored["signature"])) != json.loads(json.dumps(signature)):
                return None
            unreadable = {int(frame): why for frame, why in json.loads(str(stored["unreadable"])).items()}
            tables = {name: stored[name] for name in ("survivors", "motion", "offsets", "points")}
            return OverlapIndex(**tables, unreadable=unreadable)
    except Exception:  # a damaged zip file can raise almost anything, and an index can always be measured again
        return None
