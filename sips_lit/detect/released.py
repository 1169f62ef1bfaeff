"""Trained networks that come with the package: files of known content, called by name."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from sips_lit.errors import BadInputError

WEIGHTS: Final = Path(__file__).parents[1] / "weights"
"""The folder of the files, each with its model card."""
SHA256: Final = {
    "sips-small": "63e6ac3dfb4f8ae0adef86dae838c0bdc82bc07b88b0ca7a34e2a35a24365e01",
    "sips-tiny": "b9e4e222ce548d8f7c8252ca547983a87896bed1527d1db14bcc32cd3fafb3cb",
}
"""Names, with the hash of ``<name>.safetensors``."""
DEFAULT: Final = "sips-tiny"
"""The fast one: it needs no more points than the others."""


def checkpoint_file(checkpoint: str | Path) -> Path:
    """The file of a checkpoint: that of a released network, checked, or the path that was given.

    Raises BadInputError when the file of a released network is not what was released, and when there is no such file.
    """
    name = str(checkpoint)
    if name not in SHA256:
        path = Path(checkpoint)
        if not path.is_file():
            raise BadInputError(
                f"there is no checkpoint {path}: give a .ckpt file of a run, an exported .safetensors file, or the name of "
                f"released weights ({', '.join(SHA256)})"
            )
        return path
    path = WEIGHTS / f"{name}.safetensors"
    try:
        found = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise BadInputError(f"the weights {name} can't be read ({error}): install sips_lit again") from error
    if found != SHA256[name]:
        raise BadInputError(f"{path} is not what was released (its SHA-256 is {found}): install sips_lit again")
    return path
