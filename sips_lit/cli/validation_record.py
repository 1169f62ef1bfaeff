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
    write_whole(folder / FILE, yaml.safe_dump(record, sort_keys=False).encode())
    return digest_in(folder) or ""


def digest_in(folder: Path) -> str | None:
    """Eight characters that differ where the records of two runs do; None for a folder without one."""
    file = folder / FILE
    return hashlib.sha256(file.read_bytes()).hexdigest()[:8] if file.is_file() else None
