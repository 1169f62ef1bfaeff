"""Random crops of any frames of any sequences: what a network learns from that imitates another one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import TRIES, SkippedItems
from sips_lit.train.stream import loaded, of_all_processes
from sips_lit.types import GreyImage


@dataclass(frozen=True, slots=True)
class CropBatch:
    """B crops of side S with a margin of m pixels: ``images`` (B, 1, S + 2m, S + 2m) uint8.

    ``inside`` (B, 1, S, S) bool: which pixels of the crops are in their frames, for frames that are smaller than S;
    ``names`` of the frames; ``skipped``: why others could not be read in their place.
    """

    images: Tensor
    inside: Tensor
    names: tuple[str, ...]
    skipped: tuple[str, ...] = ()

    def to(self, device: torch.device) -> CropBatch:
        """The same on a device."""
        return replace(self, images=self.images.to(device), inside=self.inside.to(device))

    def plain(self) -> dict[str, Any]:
        """As tensors and strings, which load without running code."""
        return {"names": list(self.names), "images": self.images.cpu(), "inside": self.inside.cpu()}


def cut(
    image: GreyImage, top: int, left: int, size: int, margin: int, change: Callable[[GreyImage], GreyImage]
) -> tuple[GreyImage, NDArray[np.bool_]]:
    """A crop (size + 2 margin, size + 2 margin) about rows ``top`` and columns ``left`` on, and its pixels in the image.

    The margin holds the pixels of the image that are there, so that no border is seen within it; where the image ends
    they are replicated, after the ``change`` of the light, as a network pads a whole image.
    """
    height, width = image.shape
    y0, x0, y1, x1 = top - margin, left - margin, top + size + margin, left + size + margin
    there = change(np.ascontiguousarray(image[max(y0, 0) : y1, max(x0, 0) : x1]))
    outside = max(-y0, 0), max(y1 - height, 0), max(-x0, 0), max(x1 - width, 0)
    inside = np.zeros((size, size), bool)
    inside[: height - top, : width - left] = True
    return np.asarray(cv2.copyMakeBorder(there, *outside, cv2.BORDER_REPLICATE), np.uint8), inside


@dataclass(slots=True)
class TrainingCrops:
    """Batch number i of a run, the same whichever worker makes it and after whichever interruption.

    ``count`` crops of side ``size``, with ``margin`` pixels around it, each of another frame: of a source by its weight, of
    that any frame with equal probability. In place of a frame that can't be read another is drawn.
    """

    sources: Sequence[Source]
    augmentation: Augmentation | None
    length: int
    seed: int
    count: int
    size: int
    margin: int
    what = "batch of crops"

    def __len__(self) -> int:
        return self.length

    def draw(self, number: int, attempt: int = 0) -> tuple[int, int, int]:
        """Source, sequence and frame of crop ``number`` of the run, or of the one in its place at a later attempt."""
        generator = np.random.default_rng([self.seed, attempt, number, 3])  # apart from the streams of pairs
        weights = np.cumsum([source.weight for source in self.sources])
        at = int(np.searchsorted(weights, generator.random() * weights[-1], side="right"))
        ends = np.cumsum([len(sequence) for sequence in self.sources[at].sequences])
        place = int(generator.integers(ends[-1]))
        sequence = int(np.searchsorted(ends, place, side="right"))
        return at, sequence, place - int(ends[sequence] - len(self.sources[at].sequences[sequence]))

    def name(self, index: int) -> str:
        """The frame of the first crop of batch ``index``, if it can be read."""
        return self._frame(*self.draw(index * self.count))

    def __getitem__(self, index: int) -> CropBatch | BadInputError:
        """Batch ``index``; the error when `TRIES` frames in a row can't be read: raised, it would lose its message."""
        try:
            crops = [self._crop(index * self.count + at) for at in range(self.count)]
        except BadInputError as error:
            return error
        images, inside, names, skipped = zip(*crops, strict=True)
        stacked = [torch.from_numpy(np.stack(arrays))[:, None] for arrays in (images, inside)]
        return CropBatch(stacked[0], stacked[1], names, sum(skipped, ()))

    def _frame(self, at: int, sequence: int, frame: int) -> str:
        return f"{self.sources[at].sequences[sequence].name}:{frame}"

    def _crop(self, number: int) -> tuple[GreyImage, NDArray[np.bool_], str, tuple[str, ...]]:
        skipped: list[str] = []
        for attempt in range(TRIES):
            at, sequence, frame = self.draw(number, attempt)
            name = self._frame(at, sequence, frame)
            try:
                image = self.sources[at].sequences[sequence].frame(frame)
            except BadInputError as error:
                skipped.append(str(error))
            except OSError as error:
                skipped.append(f"{name} can't be read: {error.filename or 'its files'}: {error.strerror or error}")
            else:
                return *self._changed(image, np.random.default_rng([self.seed, 0, number, 4])), name, tuple(skipped)
        raise BadInputError(f"{TRIES} frames in a row can't be read; the first: {skipped[0]}")

    def _changed(self, image: GreyImage, generator: np.random.Generator) -> tuple[GreyImage, NDArray[np.bool_]]:
        augmentation = self.augmentation
        if augmentation is not None:
            image = augmentation.change_shape(image, generator)
        top, left = (int(generator.integers(max(0, length - self.size) + 1)) for length in image.shape)

        def light(crop: GreyImage) -> GreyImage:
            return crop if augmentation is None else augmentation.change_look(crop, generator)

        return cut(image, top, left, self.size, self.margin, light)


class CropStream:
    """Yields batches of crops; its state is its position, with which a resumed run continues as if never interrupted.

    ``skipped`` counts the frames that can't be read; ``workers`` and ``timeout``: see `loaded`; ``first`` and ``stride``:
    which batches this process takes.
    """

    def __init__(
        self, crops: TrainingCrops, workers: int, timeout: float, skipped: SkippedItems, first: int = 0, stride: int = 1
    ) -> None:
        self.crops, self.workers, self.timeout, self.skipped = crops, workers, timeout, skipped
        self.indices, self.position = range(first, len(crops), stride), 0

    def __len__(self) -> int:
        """Batches in the whole stream: independent of the position, as Lightning counts them from the start."""
        return len(self.indices)

    def __iter__(self) -> Iterator[CropBatch]:
        """Continues at ``position``. Raises BadInputError when too many frames can't be read."""
        for batch in loaded(self.crops, self.indices[self.position :], self.workers, self.timeout):
            if isinstance(batch, BadInputError):
                raise batch
            self.position += 1
            self.skipped.add(batch.skipped, self.position * self.crops.count)
            yield batch

    def state_dict(self) -> dict[str, Any]:
        """Plain numbers, as a checkpoint may hold, of all processes."""
        return {"position": self.position, "processes": of_all_processes(self.skipped.state_dict())}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue where the state was taken; with another number of processes at the same place of the stream."""
        states, stride = state["processes"], self.indices.step
        self.position = state["position"] * len(states) // stride
        self.skipped.load_state_dict(states[self.indices.start if len(states) == stride else 0])
