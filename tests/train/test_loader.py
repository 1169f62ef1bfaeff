import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
import torch.multiprocessing as mp
from textured_scenes import flight
from threadpoolctl import threadpool_info, threadpool_limits
from train_stream import LENGTH, Learner, after_interruption, assert_same, loader, pairs_of, run

from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.inliers.klt import KltInliers
from sips_lit.train.loader import LabelledPair, OneStepAhead


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


@pytest.mark.parametrize("stop", [1, 3])
def test_a_resumed_stream_has_the_points_of_the_frames_between(stop, tmp_path):
    """Only pairs that KLT labels have such; their labels are those of whole tracks."""
    learner = Learner()
    expected = run(loader(learner, between=2), learner)
    rest, _, resumed = after_interruption(lambda learner: loader(learner, between=2), stop, tmp_path)
    for pair, other in zip(rest, expected[stop:], strict=True):
        assert_same(pair, other)
    inner = [
        0 if p.source else min(2, abs(int(np.subtract(*map(int, p.name.split(":")[1].split("-"))))) - 1)
        for p in expected
    ]
    assert {0} < set(inner)
    assert [step for kind, step in learner.events if kind == "select"].count(1) == 2 + inner[2]
    assert sum(kind == "select" for kind, _ in learner.events) == 2 * LENGTH + sum(inner)
    assert sum(kind == "select" for kind, _ in resumed.events) == 2 * (LENGTH - stop - 1) + sum(inner[stop + 1 :])


@pytest.mark.parametrize("labelling", [1, 2, 5])
def test_the_points_of_a_step_of_several_pairs_are_all_selected_before_the_step_before(labelling):
    learner = Learner()
    taken = run(loader(learner, labelling=labelling, pairs_per_step=3, length=8), learner)
    assert len(taken) == 8
    # two steps at first; the last has two pairs
    assert learner.events == [("select", 0)] * 12 + [("step", 0)] + [("select", 1)] * 4 + [("step", 1)]


@pytest.mark.parametrize(("at_once", "asked"), [(1, [1] * 16), (2, [4, 4, 4, 4]), (3, [6, 6, 4]), (5, [10, 2, 4])])
def test_images_of_several_pairs_are_selected_in_together(at_once, asked):
    alone, together = Learner(), Learner()
    expected = run(loader(alone, pairs_per_step=3, length=8), alone)
    taken = run(loader(together, pairs_per_step=3, length=8, pairs_at_once=at_once), together)
    assert together.together == asked  # six pairs at first, then the last two
    for pair, other in zip(taken, expected, strict=True):
        assert_same(pair, other)
        assert pair.seconds["select"] > 0


@pytest.mark.parametrize(("ranks", "each"), [(2, 1), (3, 1), (2, 2)])
def test_several_processes_label_what_one_does_that_takes_their_pairs_a_step(ranks, each):
    length, learner = 3 * ranks * each, Learner()
    together = run(loader(learner, pairs_per_step=ranks * each, length=length), learner)
    for rank in range(ranks):
        learner = Learner()
        share = run(loader(learner, first=rank, stride=ranks, pairs_per_step=each, length=length), learner)
        assert len(share) == 3 * each
        for pair, other in zip(share, together[rank::ranks], strict=True):
            assert_same(pair, other)


@pytest.mark.parametrize("steps", [1, 2])
def test_a_resumed_stream_of_several_pairs_a_step_goes_on_as_if_never_interrupted(steps, tmp_path):
    def several(learner: Learner) -> OneStepAhead:
        return loader(learner, pairs_per_step=2, length=8)

    learner = Learner()
    whole = run(several(learner), learner)
    first = Learner()
    stream = several(first)
    run(stream, first, 2 * steps)
    torch.save(stream.state_dict(), tmp_path / "state.pt")
    resumed = Learner(steps=steps)
    again = several(resumed)
    again.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    for pair, other in zip(run(again, resumed), whole[2 * steps :], strict=True):
        assert_same(pair, other)


def test_of_a_step_of_very_many_pairs_some_are_selected_ahead(monkeypatch):
    monkeypatch.setattr("sips_lit.train.loader.MOST_AHEAD", 2)
    learner = Learner()
    stream = iter(loader(learner, pairs_per_step=1000, length=8))
    next(stream)
    assert learner.events == [("select", 0)] * 8
    assert len(list(stream)) == 7


def test_a_finished_stream_stays_finished():
    learner = Learner()
    stream = loader(learner)
    run(stream, learner)
    again = loader(Learner())
    again.load_state_dict(stream.state_dict())
    assert list(again) == []
    assert stream.state_dict()["processes"][0]["ahead"] == []


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


def blas_threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_products_of_labels_take_one_thread_while_there_are_pairs_to_label():
    with threadpool_limits(2, user_api="blas"):
        before, taken = blas_threads(), set()
        learner = Learner()
        for _ in loader(learner):
            taken |= blas_threads()
            learner.step()
        assert taken == {1}
        assert blas_threads() == before == {2}


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


@pytest.mark.parametrize(
    "error", [EOFError(), ConnectionResetError(104, "reset by peer"), OSError("got end of file during message")]
)
def test_a_worker_that_dies_while_it_is_read_from_is_a_lost_worker(error, monkeypatch):
    class Dying:
        def __init__(self, *args, **options):
            pass

        def __iter__(self):
            return self

        def __next__(self):
            raise error

    monkeypatch.setattr("sips_lit.train.stream.DataLoader", Dying)
    learner = Learner()
    with pytest.raises(RuntimeError, match=r"DataLoader worker .* exited unexpectedly"):
        run(loader(learner, 1), learner)


def stored_after(stop: int, monkeypatch) -> dict:
    """What a checkpoint of two processes holds: each asks for the points of the others, as by `torch.distributed`."""
    own = []
    for first in (0, 1):
        learner = Learner()
        stream = loader(learner, first=first, stride=2)
        run(stream, learner, stop)
        own += stream.state_dict()["processes"]
    monkeypatch.setattr("sips_lit.train.loader.of_all_processes", lambda _: own)
    return stream.state_dict()


@pytest.mark.parametrize("first", [0, 1])
def test_each_of_two_processes_goes_on_with_its_own_points(monkeypatch, first):
    learner = Learner()
    whole = run(loader(learner, first=first, stride=2), learner)
    learner = Learner()
    run(loader(learner, first=first, stride=2), learner, 1)  # the learner as it was then
    again = loader(learner, first=first, stride=2)
    again.load_state_dict(stored_after(1, monkeypatch))
    rest = run(again, learner)
    assert len(rest) == len(whole) - 1 > 0
    for pair, other in zip(rest, whole[1:], strict=True):
        assert_same(pair, other)


def test_another_number_of_processes_goes_on_at_the_same_place(monkeypatch):
    names = [pair.name for pair in run(loader(Learner()), Learner())]
    learner = Learner()
    alone = loader(learner)
    alone.load_state_dict(stored_after(1, monkeypatch))  # one pair each
    rest = run(alone, learner)
    assert [pair.name for pair in rest] == names[2:]
    assert learner.events[:5] == [("select", 0)] * 4 + [("step", 0)]  # not the points that the two processes had


def test_another_number_of_processes_goes_on_in_the_middle_of_a_step(monkeypatch):
    names = [pair.name for pair in run(loader(Learner()), Learner())]
    learner = Learner()
    alone = loader(learner, pairs_per_step=4)
    alone.load_state_dict(stored_after(1, monkeypatch))
    assert [pair.name for pair in run(alone, learner)] == names[2:]


def stop_workers() -> None:
    """Loading workers stand still, as they do when a disk does not answer."""
    for child in mp.active_children():
        os.kill(child.pid, signal.SIGSTOP)


def take_all(stream: OneStepAhead, learner: Learner, taken: list[LabelledPair], hang_after: int = 0) -> None:
    """Takes all pairs; the workers stand still after some of them."""
    for pair in stream:
        taken.append(pair)
        learner.step()
        if len(taken) == hang_after:
            time.sleep(0.3)  # what is loaded ahead waits in the workers: fetching it hangs, too
            stop_workers()


@pytest.mark.parametrize("hang_after", [1, 3])
@pytest.mark.parametrize("workers", [1, 2])
def test_workers_that_hang_are_replaced_and_no_pair_is_lost(workers, hang_after, expected):
    learner, taken = Learner(), []
    stream = loader(learner, workers)
    stream.loading_timeout = 1.0
    told = r"no training pair came for 1 s \(the next is .*:\d+-\d+\): .* are replaced"
    with pytest.warns(InputWarning, match=told):
        take_all(stream, learner, taken, hang_after)
    assert len(taken) == LENGTH
    for pair, other in zip(taken, expected, strict=True):
        assert_same(pair, other)
    assert mp.active_children() == []


class Hanging:
    """Pairs of which one never comes."""

    def __init__(self, pairs, index: int) -> None:
        self.pairs, self.index = pairs, index
        self.name, self.what = pairs.name, pairs.what

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: int):
        if index == self.index:
            signal.pause()
        return self.pairs[index]


@pytest.mark.filterwarnings("ignore:no training pair came")
def test_a_pair_that_never_comes_ends_the_run_with_its_name():
    learner, taken = Learner(), []
    stream = loader(learner, 1)
    stream.pairs, stream.loading_timeout = Hanging(stream.pairs, 4), 1.0
    with pytest.raises(BadInputError, match=r"the next is .*\), from new loading workers, .*loading_timeout") as caught:
        take_all(stream, learner, taken)
    assert stream.pairs.name(4) in str(caught.value)
    assert len(taken) == 3  # pair 3 was waiting for its label
    assert mp.active_children() == []


def test_nobody_waits_for_a_worker_that_stands_still_when_the_run_is_interrupted():
    learner = Learner()
    pairs = iter(loader(learner, 2))
    next(pairs)
    stop_workers()
    began = time.monotonic()
    pairs.close()
    assert time.monotonic() - began < 6
    assert mp.active_children() == []


ERROR_IN_A_STEP = """
import sys
sys.path[:0] = {paths!r}
from train_stream import Learner, loader

stream = iter(loader(Learner(), loading=2))
next(stream)
{fails}
"""


@pytest.mark.parametrize("fails", ["raise RuntimeError('a defect')", "sys.exit(1)"])
def test_a_run_that_fails_between_two_pairs_ends(fails):
    """The stream ends with the interpreter then, which starts no threads any more."""
    script = ERROR_IN_A_STEP.format(paths=sys.path, fails=fails)
    assert subprocess.run([sys.executable, "-c", script], timeout=60, capture_output=True).returncode == 1


def test_an_error_while_points_are_selected_ends_the_loading_workers():
    class Failing(Learner):
        def select(self, images):
            raise RuntimeError("a defect")

    error = None
    try:
        next(iter(loader(Failing(), loading=2)))
    except RuntimeError as caught:
        error = caught  # and with it the frames that it went through
    assert str(error) == "a defect"
    assert mp.active_children() == []
