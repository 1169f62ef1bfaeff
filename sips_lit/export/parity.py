"""Whether an exported model gives what the detector gives, asked of its runtime before anything is written."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.openvino_package import openvino_core
from sips_lit.detect.selection import score_map
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.program import Exportable, Size
from sips_lit.export.top_k import TopPoints
from sips_lit.types import GreyImage, Keypoints

Run = Callable[[NDArray[Any]], list[NDArray[Any]]]
"""From an image (B, 1, H, W) to the outputs of a model, in order."""

SHAPES: Final = ((1, 1, 240, 320), (2, 1, 97, 131), (1, 1, 5, 3), (1, 1, 1, 1))
"""(B, 1, H, W) that both are compared on: usual, odd in a batch, and smaller than the receptive field."""
TOLERANCE: Final = 1e-4
"""Greatest difference of probabilities that is let through."""
COVARIANCE: Final = 1e-3
"""Greatest relative difference of covariances that is let through."""
PIXELS: Final = 0.01
"""How far a point may be from the detector's to be the same."""
SHARE: Final = 0.01
"""Of points that need not be the same: two that are equally good to the last digit may come in another order at the end."""


def run_onnx(content: bytes) -> Run:
    """ONNX Runtime on a CPU."""
    import onnxruntime

    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    return lambda image: [np.asarray(output) for output in session.run(None, {"image": image})]


def run_openvino(xml: bytes, weights: bytes) -> Run:
    """OpenVINO on a CPU, in float32: half precision, which it takes by itself where the processor has it, moves points."""
    core = openvino_core("format=openvino")
    options = {"INFERENCE_PRECISION_HINT": "f32"}
    compiled = core.compile_model(core.read_model(xml, weights), "CPU", options)

    def run(image: NDArray[Any]) -> list[NDArray[Any]]:
        results = compiled(image)
        return [np.asarray(results[index]) for index in range(len(results))]

    return run


def run_program(content: bytes) -> Run:
    """PyTorch, of a ``.pt2`` file."""
    module = torch.export.load(io.BytesIO(content)).module()

    @torch.no_grad()
    def run(image: NDArray[Any]) -> list[NDArray[Any]]:
        return [output.numpy() for output in module(torch.from_numpy(image))]

    return run


@dataclass(frozen=True, slots=True)
class Difference:
    """From model to detector: of ``points``, ``moved`` ones are not the same; ``score``: the most in probability.

    ``covariance``: the most in covariance, relative to the determinant's root; 0 for models without.
    """

    score: float
    points: int = 0
    moved: int = 0
    covariance: float = 0.0

    @property
    def is_small(self) -> bool:
        """Whether the model may be written."""
        small = self.score <= TOLERANCE and self.covariance <= COVARIANCE
        return small and self.moved <= SHARE * self.points

    def __str__(self) -> str:
        probabilities = f"probabilities differ by at most {self.score:.1e}"
        if not self.points:
            return probabilities
        points = (
            f"{self.points - self.moved} of {self.points} points are the same within {PIXELS:g} px, {probabilities}"
        )
        return f"{points}, covariances by {self.covariance:.1e}" if self.covariance else points


def difference_of(model: Exportable, run: Run, image_type: str = "float32", size: Size | None = None) -> Difference:
    """Compares on images of `SHAPES`, as ``image_type``; on one of ``size`` for models that take no other."""
    scores, points, moved, covariance = [], 0, 0, 0.0
    for images in _images(SHAPES if size is None else ((1, 1, *size),)):
        outputs = run(images.astype(image_type))
        for index, image in enumerate(images[:, 0]):
            mine = [output[index] for output in outputs]
            if isinstance(model, DenseMap):
                expected = score_map(model.network, image, model.selector.recalibration)
                scores.append(float(np.abs(mine[0][0] - expected).max()))
            else:
                one = difference_of_points(dict(zip(model.outputs, mine, strict=True)), expected_points(model, image))
                scores.append(one.score)
                points, moved = points + one.points, moved + one.moved
                covariance = float(np.maximum(covariance, one.covariance))
    return Difference(float(np.max(scores)), points, moved, covariance)  # NaN if one is


def expected_points(model: TopPoints, image: GreyImage) -> Keypoints:
    """The points that the detector itself finds."""
    return SipsDetector(model.network, model.selector).within(image, model.budget)[0]


def difference_of_points(outputs: Mapping[str, NDArray[Any]], expected: Keypoints) -> Difference:
    """Of the outputs of a model for one image by their names: keypoints (N, 2), scores (N,), count, and covariance."""
    count = int(outputs["count"])
    xy, score = outputs["keypoints"][:count], outputs["scores"][:count]
    same = np.abs(xy[:, None] - expected.xy).max(-1) <= PIXELS  # (mine, expected)
    moved = max(int((~same).all(axis).sum()) for axis in (0, 1))
    both = min(len(score), len(expected))
    worst = np.abs(score[:both] - expected.score[:both]).max(initial=0)
    covariance = 0.0
    if expected.covariance is not None:
        mine, theirs = np.nonzero(same)
        wanted = expected.covariance[theirs]
        apart = np.abs(outputs["covariance"][mine] - wanted).max((1, 2)) / np.sqrt(np.linalg.det(wanted))
        covariance = float(apart.max(initial=0))
    return Difference(float(worst), max(len(score), len(expected)), moved, covariance)


def _images(shapes: Sequence[tuple[int, int, int, int]]) -> Iterator[NDArray[np.uint8]]:
    """Coarse and fine noise, (B, 1, H, W)."""
    generator = np.random.default_rng(0)
    for batch, _, height, width in shapes:
        coarse = generator.uniform(0, 200, (batch, height // 5 + 2, width // 5 + 2)).astype(np.float32)
        smooth = np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_CUBIC) for one in coarse])
        fine = generator.uniform(0, 40, smooth.shape)
        yield np.clip(smooth + fine, 0, 255).astype(np.uint8)[:, None]
