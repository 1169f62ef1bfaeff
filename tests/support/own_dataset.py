"""A data set of a user's own: a package outside of this one, with its SPEC, its YAML and an entry point."""

from pathlib import Path

import numpy as np

from sips_lit.types import GreyImage

MODULE = """
from pathlib import Path

import numpy as np

from sips_lit.datasets.spec import DatasetSpec, at_least
from sips_lit.errors import BadInputError
from sips_lit.types import ImageSequence


class Walk(ImageSequence):
    def __init__(self, folder):
        self.name, self.fingerprint = folder.name, str(folder)
        self.stored = np.load(folder / "walk.npz")["frames"]

    def __len__(self):
        return len(self.stored)

    def frame(self, index):
        return self.stored[index]

    def time(self, index):
        return index / 20


def walk(path, reverse=False):
    folders = [p.parent for p in sorted(Path(path).glob("**/walk.npz"))]
    if not folders:
        raise BadInputError(f"there is no walk in {path}")
    return [Walk(folder) for folder in folders][:: -1 if reverse else 1]


SPEC = DatasetSpec(
    kind="walk",
    title="Walks",
    loader=walk,
    signs=(at_least(1, "walk.npz"),),
    family=True,
    has=("times",),
    keys=("hydra.searchpath=[pkg://walks.conf]",),
)
"""
YAML = """
_target_: walks.walk.walk
path: ???
reverse: false
"""


def write_package(root: Path, entry_point: str = "walks.walk:SPEC") -> Path:
    """As pip would have installed it into ``root``."""
    files = {
        "walks/__init__.py": "",
        "walks/walk.py": MODULE,
        "walks/conf/__init__.py": "",
        "walks/conf/data/walk.yaml": YAML,
        "walks-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: walks\nVersion: 1.0\n",
        "walks-1.0.dist-info/entry_points.txt": f"[sips_lit.datasets]\nwalks = {entry_point}\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def write_walk(folder: Path, frames: list[GreyImage]) -> Path:
    """A data set in the layout of that package."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "walk.npz", frames=np.stack(frames))
    return folder
