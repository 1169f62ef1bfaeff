"""What the validation of a run was measured on: scores of runs compare only where it is the same."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import yaml
from omegaconf import DictConfig, OmegaConf

from sips_lit.files import make_folder, write_whole

FILE: Final = "validation.yaml"
"""In the folder of a run: inliers needed, points at most, what verifies, and the pairs."""


def write_record(config: DictConfig, pairs: Sequence[str]) -> str:
    """Writes it, with the names of the ``pairs``, and returns its digest."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    record = {key: plain[key] for key in ("k", "n_max", "inliers")} | {"pairs": list(pairs)}
    folder = Path(config.paths.run)
    make_folder(folder)
    content = yaml.safe_dump(record, sort_keys=False).encode()
    write_whole(folder / FILE, content)
    return _digest(content)


def digest_in(folder: Path) -> str | None:
    """Eight characters that differ where the records of two runs do; None for a folder without one."""
    file = folder / FILE
    return _digest(file.read_bytes()) if file.is_file() else None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:8]
