from collections.abc import Sequence

import numpy as np
import torch
from overlap_rows import all_overlap
from textured_scenes import ArraySequence, flight

from sips_lit.describe.sift import RootSift
from sips_lit.detect.selection import SelectedPoints
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.sampler import SourceSampler
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import PackedPairs, TrainingPairs
from sips_lit.train.loader import LabelledPair, OneStepAhead
from sips_lit.types import GreyImage, Keypoints

LENGTH = 7


class Learner:
    """Selects points that depend on the image and on how many steps were taken, and writes down when it was asked."""

    def __init__(self, steps: int = 0) -> None:
        self.steps = steps
        self.events: list[tuple[str, int]] = []
        self.together: list[int] = []  # how many images it was asked for at once

    def select(self, images: Sequence[GreyImage]) -> list[SelectedPoints]:
        self.together.append(len(images))
        return list(map(self.select_in, images))

    def select_in(self, image: GreyImage) -> SelectedPoints:
        self.events.append(("select", self.steps))
        generator = np.random.default_rng([self.steps, int(image.sum())])
        xy = generator.uniform(0, [image.shape[1] - 1, image.shape[0] - 1], (20, 2)).astype(np.float32)
        score = np.sort(generator.random(20).astype(np.float32))[::-1].copy()
        places = xy.round().astype(np.int64)
        points = Keypoints(xy, score, np.ones(20, np.float32))
        return SelectedPoints(points, np.zeros(20, np.int64), places[:, 1], places[:, 0])

    def step(self) -> None:
        self.events.append(("step", self.steps))
        self.steps += 1


def pairs_of(*sequences: ArraySequence, length: int = LENGTH) -> PackedPairs:
    """The first sequence is labelled by KLT, the others by their homographies."""
    sources = [Source([s], inliers=HomographyInliers() if i else None) for i, s in enumerate(sequences)]
    sampler = SourceSampler(sources, [all_overlap(len(s)) for s in sequences], 0.5, seed=1)
    return PackedPairs(TrainingPairs(sources, sampler, KltInliers(), Augmentation(), length))


def loader(
    learner: Learner,
    loading: int = 0,
    labelling: int = 1,
    first: int = 0,
    stride: int = 1,
    between: int = 0,
    pairs_per_step: int = 1,
    length: int = LENGTH,
    pairs_at_once: int = 1,
) -> OneStepAhead:
    pairs = pairs_of(flight(5, size=(80, 64)), flight(4, size=(72, 60), seed=1, name="other"), length=length)
    checks = [KltInliers(), HomographyInliers()]
    more = {"between": between, "pairs_per_step": pairs_per_step, "pairs_at_once": pairs_at_once}
    return OneStepAhead(pairs, learner.select, RootSift(), checks, loading, labelling, first, stride, **more)


def run(stream: OneStepAhead, learner: Learner, steps: int | None = None) -> list[LabelledPair]:
    """Takes pairs as a trainer does: a step of the learner after as many as one is."""
    taken = []
    for pair in stream:
        taken.append(pair)
        if len(taken) % stream.pairs_per_step == 0:
            learner.step()
        if len(taken) == steps:
            break
    return taken


def after_interruption(make, stop: int, folder) -> tuple[list[LabelledPair], OneStepAhead, Learner]:
    """The pairs after ``stop`` of a stream that was stored then, with the stream and the learner that went on."""
    learner = Learner()
    first = make(learner)
    run(first, learner, stop)
    torch.save(first.state_dict(), folder / "state.pt")
    resumed = Learner(steps=stop)
    second = make(resumed)
    second.load_state_dict(torch.load(folder / "state.pt", weights_only=True))
    return run(second, resumed), second, resumed


def assert_same(a: LabelledPair, b: LabelledPair) -> None:
    assert (a.name, a.source) == (b.name, b.source)
    torch.testing.assert_close((a.image0, a.image1), (b.image0, b.image1), rtol=0, atol=0)
    for one, other in ((a.points0, b.points0), (a.points1, b.points1)):
        np.testing.assert_array_equal(one.keypoints.xy, other.keypoints.xy)
        np.testing.assert_array_equal(one.keypoints.score, other.keypoints.score)
        np.testing.assert_array_equal((one.level, one.row, one.column), (other.level, other.row, other.column))
    for one, other in ((a.labels0, b.labels0), (a.labels1, b.labels1)):
        np.testing.assert_array_equal(one.reason, other.reason)
        np.testing.assert_array_equal((one.inlier, one.known), (other.inlier, other.known))
        np.testing.assert_array_equal(one.share, other.share)
