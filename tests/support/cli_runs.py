"""What the tests of the commands share: a tiny run, frames as files, how a command ended."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from sips_lit.types import GreyImage

ROOT = Path(__file__).parents[2]
TINY = [
    "model.depth=3",
    "model.width=4",
    "module.points=40",
    "n_max=60",
    "datamodule.val_fraction=0.3",
    "datamodule.val_pairs=2",
    "datamodule.loading_workers=0",
    "datamodule.labelling_workers=1",
    "callbacks.pictures.count=1",
    "trainer.max_steps=2",
    "trainer.precision=32-true",
    "trainer.accelerator=cpu",
]


@dataclass(frozen=True)
class Result:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """The message of a command that refuses its input: one line, no traceback."""
        assert self.code == 1, self.err
        assert "Traceback" not in self.err
        lines = [line for line in self.err.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1, self.err
        return lines[0].removeprefix("error: ")


Command = Callable[..., Result]


def write_frames(folder: Path, frames: Sequence[GreyImage]) -> Path:
    """Images of a camera as files."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, frame in enumerate(frames):
        assert cv2.imwrite(str(folder / f"{index:03d}.png"), frame)
    return folder
