import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight

from sips_lit.describe.sift import RootSift
from sips_lit.detect.selection import SelectedPoints
from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.tracking.overlap import OverlapIndex
from sips_lit.tracking.source_pairs import SourceSampler
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

    def select(self, image: GreyImage) -> SelectedPoints:
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


def all_overlap(length: int) -> OverlapIndex:
    counts = np.arange(length)[::-1]
    survivors = np.full(counts.sum(), 9, np.uint16)
    return OverlapIndex(survivors, np.concatenate([[0], np.cumsum(counts)]), np.full(length, 9))


def pairs_of(*sequences: ArraySequence, length: int = LENGTH) -> PackedPairs:
    """The first sequence is labelled by KLT, the others by their homographies."""
    sources = [Source([s], inliers=HomographyInliers() if i else None) for i, s in enumerate(sequences)]
    sampler = SourceSampler(sources, [all_overlap(len(s)) for s in sequences], 0.5, seed=1)
    return PackedPairs(TrainingPairs(sources, sampler, KltInliers(), Augmentation(), length))


def loader(learner: Learner, loading: int = 0, labelling: int = 1, first: int = 0, stride: int = 1) -> OneStepAhead:
    pairs = pairs_of(flight(5, size=(80, 64)), flight(4, size=(72, 60), seed=1, name="other"))
    checks = [KltInliers(), HomographyInliers()]
    return OneStepAhead(pairs, learner.select, RootSift(), checks, loading, labelling, first, stride)


def run(stream: OneStepAhead, learner: Learner, steps: int | None = None) -> list[LabelledPair]:
    """Takes pairs as a trainer does: a step of the learner after each."""
    taken = []
    for pair in stream:
        taken.append(pair)
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


@pytest.fixture(scope="module")
def expected() -> list[LabelledPair]:
    """All pairs of a run without any worker."""
    learner = Learner()
    return run(loader(learner), learner)


@pytest.mark.parametrize(("loading", "labelling"), [(0, 1), (0, 3), (1, 1), (2, 3)])
def test_points_are_selected_exactly_one_step_ahead(loading, labelling, expected):
    learner = Learner()
    taken = run(loader(learner, loading, labelling), learner)
    # the first two pairs are selected before the first step, pair t + 1 before step t
    order = [("select", 0)] * 4 + [("step", 0)]
    for step in range(1, LENGTH):
        order += [("select", step)] * (2 if step < LENGTH - 1 else 0) + [("step", step)]
    assert learner.events == order
    assert len(taken) == len(expected) == LENGTH
    for pair, other in zip(taken, expected, strict=True):
        assert_same(pair, other)


def test_labels_are_of_the_points_and_images_of_their_pair(expected):
    assert {pair.source for pair in expected} == {0, 1}  # both inlier checks took part
    for pair in expected:
        for image, points, labels in (
            (pair.image0, pair.points0, pair.labels0),
            (pair.image1, pair.points1, pair.labels1),
        ):
            assert image.shape == ((1, 1, 64, 80) if pair.source == 0 else (1, 1, 60, 72))
            assert image.dtype == torch.float32
            assert len(points) == len(labels.inlier) == len(labels.known) == len(labels.reason) == 20


@pytest.mark.parametrize("stop", [1, 3, LENGTH - 1])
@pytest.mark.parametrize("loading", [0, 2])
def test_a_resumed_stream_goes_on_as_if_never_interrupted(stop, loading, expected, tmp_path):
    rest, _, resumed = after_interruption(lambda learner: loader(learner, loading), stop, tmp_path)
    assert len(rest) == LENGTH - stop
    for pair, other in zip(rest, expected[stop:], strict=True):
        assert_same(pair, other)
    # the points that were selected before the interruption are not selected again
    before_first_step = resumed.events[: resumed.events.index(("step", stop))]
    assert len(before_first_step) == (2 if stop < LENGTH - 1 else 0)


def test_a_finished_stream_stays_finished():
    learner = Learner()
    stream = loader(learner)
    run(stream, learner)
    again = loader(Learner())
    again.load_state_dict(stream.state_dict())
    assert list(again) == []
    assert stream.state_dict()["ahead"] == []


@pytest.mark.parametrize("ranks", [2, 3])
def test_processes_share_the_stream_without_overlap(ranks, expected):
    shares = []
    for rank in range(ranks):
        learner = Learner()
        stream = loader(learner, first=rank, stride=ranks)
        shares.append([pair.name for pair in run(stream, learner)])
        assert len(stream) == len(shares[-1])
    merged: list[str | None] = [None] * LENGTH
    for rank, share in enumerate(shares):
        merged[rank::ranks] = share
    assert merged == [pair.name for pair in expected]


def test_the_length_is_that_of_the_whole_stream_wherever_it_stands():
    learner = Learner()
    stream = loader(learner)
    assert len(stream) == LENGTH
    run(stream, learner, 3)
    assert len(stream) == LENGTH
    assert len(loader(learner, first=1, stride=2)) == 3


def test_an_empty_stream_selects_nothing():
    learner = Learner()
    assert list(OneStepAhead(pairs_of(flight(3), length=0), learner.select, RootSift(), [KltInliers()], 0, 1)) == []
    assert learner.events == []


def test_a_stream_of_one_pair():
    learner = Learner()
    stream = OneStepAhead(pairs_of(flight(3), length=1), learner.select, RootSift(), [KltInliers()], 0, 2)
    assert len(run(stream, learner)) == 1
    assert learner.events == [("select", 0), ("select", 0), ("step", 0)]


def test_an_error_while_labelling_is_raised():
    class Failing(RootSift):
        def describe(self, image, keypoints):
            raise BadInputError("this descriptor is broken")

    learner = Learner()
    stream = OneStepAhead(pairs_of(flight(3)), learner.select, Failing(), [KltInliers()], 0, 2)
    with pytest.raises(BadInputError, match="this descriptor is broken"):
        run(stream, learner)


def test_only_images_move_to_the_device(expected):
    moved = expected[0].to(torch.device("meta"))
    assert moved.image0.is_meta
    assert moved.image1.is_meta
    assert moved.points0 is expected[0].points0
    assert moved.labels1 is expected[0].labels1


@pytest.mark.parametrize("error", [EOFError(), ConnectionResetError(104, "reset by peer")])
def test_a_worker_that_dies_while_it_is_read_from_is_a_lost_worker(error, monkeypatch):
    class Dying:
        def __init__(self, *args, **options):
            pass

        def __iter__(self):
            return self

        def __next__(self):
            raise error

    monkeypatch.setattr("sips_lit.train.loader.DataLoader", Dying)
    learner = Learner()
    with pytest.raises(RuntimeError, match=r"DataLoader worker .* exited unexpectedly"):
        run(loader(learner, 1), learner)
