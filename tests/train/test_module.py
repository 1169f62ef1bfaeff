import contextlib
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import lightning as L
import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, texture
from train_run import Watch, fit, make_data, make_module

from sips_lit.detect.selection import SelectedPoints, image_tensor, logits_at
from sips_lit.errors import BadInputError
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.matching.mutual_nearest import FOREVER, MutualLifetimes
from sips_lit.train.loader import LabelledPair
from sips_lit.train.loss import ranking_loss
from sips_lit.train.module import SipsModule
from sips_lit.train.source_focus import FAST
from sips_lit.types import Keypoints, Reason


def side(rows, columns, reasons) -> tuple[SelectedPoints, PointLabels]:
    rows, columns, reason = np.array(rows, np.int64), np.array(columns, np.int64), np.array(reasons, np.uint8)
    ones = np.ones(len(rows), np.float32)
    xy = np.stack([columns, rows], 1).astype(np.float32).reshape(-1, 2)
    points = SelectedPoints(Keypoints(xy, ones, ones), np.zeros(len(rows), np.int64), rows, columns)
    inlier = reason == Reason.INLIER
    return points, PointLabels(inlier, reason != Reason.UNKNOWN, reason, inlier.astype(np.float32))


def hand_made(side0, side1, index0=(), index1=()) -> LabelledPair:
    images = image_tensor(texture(40, 50)), image_tensor(texture(36, 44, 1))
    ends = np.array(index0, np.int64), np.array(index1, np.int64)
    inliers = MutualLifetimes(*ends, np.maximum(*ends) + 1, np.full(len(ends[0]), FOREVER))
    return LabelledPair(*images, side0[0], side1[0], side0[1], side1[1], inliers, 0, "hand")


class Logged(dict):
    """What a module logs outside of a trainer."""

    def __init__(self, module: SipsModule) -> None:
        super().__init__()
        data = SimpleNamespace(sources=[SimpleNamespace(name="city")])
        module._trainer = SimpleNamespace(datamodule=data, accumulate_grad_batches=1)
        module.log = lambda name, value, **_: self.update({name: float(value)})
        module.log_dict = lambda values, **_: self.update(values)


GOOD, ALONE, LOST, FAR, UNKNOWN = Reason.INLIER, Reason.UNMATCHED, Reason.LOST, Reason.FAR, Reason.UNKNOWN


@pytest.mark.parametrize("gradient", ["patches", "dense"])
def test_the_loss_is_its_plain_definition(gradient):
    module = make_module(gradient=gradient)
    logged = Logged(module)
    sides = side([3, 20, 39, 0], [4, 30, 49, 0], [GOOD, ALONE, UNKNOWN, FAR]), side([10, 35], [43, 0], [GOOD, LOST])
    pair = hand_made(*sides)
    loss = module.training_step(pair, 0)

    expected, terms = 0.0, 0
    for image, (points, labels) in zip((pair.image0, pair.image1), sides, strict=True):
        p = torch.sigmoid(module(image))[0, 0].detach().double()
        for row, column, inlier, known in zip(points.row, points.column, labels.inlier, labels.known, strict=True):
            if known:
                expected -= float(torch.log(p[row, column] if inlier else 1 - p[row, column]))
                terms += 1
    assert float(loss.detach()) == pytest.approx(expected, rel=1e-5)
    assert terms == 5
    assert logged["train/loss"] == pytest.approx(expected / 5, rel=1e-5)
    entropy = -(0.4 * np.log(0.4) + 0.6 * np.log(0.6))
    assert logged["train/excess_loss"] == pytest.approx(expected / 5 - entropy, rel=1e-5)
    assert logged["train/points"] == 6  # those whose truth is unknown were selected, too
    assert logged["labels/inlier"] == logged["inlier_rate/city"] == pytest.approx(2 / 5)
    assert logged["labels/unmatched"] == logged["labels/lost"] == logged["labels/far"] == pytest.approx(1 / 5)


@pytest.mark.parametrize("gradient", ["patches", "dense"])
@pytest.mark.parametrize(("weight", "beta"), [(0, 0.5), (0.3, 0.5), (2, 0.5), (2, 0), (2, 1e-3), (2, 9)])
def test_the_loss_adds_the_difference_of_the_logits_of_matched_points(gradient, weight, beta):
    module = make_module(gradient=gradient, consistency=weight, consistency_beta=beta)
    Logged(module)
    sides = side([3, 20, 39], [4, 30, 49], [GOOD, ALONE, GOOD]), side([10, 35, 8], [43, 0, 9], [LOST, GOOD, GOOD])
    pair = hand_made(*sides, [0, 2], [2, 1])
    loss = module.training_step(pair, 0)

    without = module.training_step(hand_made(*sides), 0)
    logits0, logits1 = (module(image)[0, 0].detach().double() for image in (pair.image0, pair.image1))
    differences = [abs(logits0[3, 4] - logits1[8, 9]), abs(logits0[39, 49] - logits1[35, 0])]
    expected = sum(d - beta / 2 if d >= beta else d**2 / (2 * beta) for d in differences)
    assert float((loss - without).detach()) == pytest.approx(weight * float(expected), rel=1e-3, abs=1e-5)


ONE_PAIR = (
    side([3, 20, 39], [4, 30, 49], [GOOD, ALONE, GOOD]), side([10, 35, 8], [43, 0, 9], [LOST, GOOD, GOOD]), [0, 2], [2, 1]
)  # fmt: skip
ANOTHER = side([5, 30], [6, 40], [GOOD, UNKNOWN]), side([5], [7], [GOOD]), [0], [0]


@pytest.mark.parametrize(("gradient", "passes_of"), [("patches", {1: 5, 2: 3}), ("dense", {1: 10, 2: 6})])
def test_pairs_seen_at_once_learn_what_they_learn_one_by_one(gradient, passes_of):
    """A step of five pairs, of which the network sees two, two and one; the images of each pair have two sizes."""
    pairs = [hand_made(*ONE_PAIR), hand_made(*ANOTHER)] * 2 + [hand_made(*ONE_PAIR)]
    gradients, told, losses = [], [], []
    for at_once in (1, 2):
        torch.manual_seed(0)
        module = make_module(gradient=gradient, pairs_at_once=at_once)
        logged = Logged(module)
        module._trainer.accumulate_grad_batches = 5
        module.zero_grad()
        passes = []
        module.network.layers[0].register_forward_hook(lambda *_, passes=passes: passes.append(1))
        for index, pair in enumerate(pairs):
            loss = module.training_step(pair, 5 + index)
            loss.backward()
            losses.append(float(loss.detach()))
        assert len(passes) == passes_of[at_once]
        gradients.append([weights.grad for weights in module.network.parameters()])
        told.append(dict(logged))
    one_by_one, together = losses[:5], losses[5:]
    assert [loss > 0 for loss in together] == [False, True, False, True, True]
    assert sum(together) == pytest.approx(sum(one_by_one), rel=1e-5)
    for alone, together in zip(*gradients, strict=True):
        torch.testing.assert_close(together, alone, rtol=1e-4, atol=1e-4)
    assert told[1] == pytest.approx(told[0], rel=1e-4)  # the last pair was by itself


def test_what_is_told_of_pairs_seen_at_once_is_their_mean():
    means = []
    for at_once in (1, 2):
        torch.manual_seed(0)
        module = make_module(pairs_at_once=at_once)
        logged = Logged(module)
        module._trainer.accumulate_grad_batches = 2
        told = []
        for index, pair in enumerate((hand_made(*ONE_PAIR), hand_made(*ANOTHER))):
            logged.clear()
            module.training_step(pair, index)
            told.append({name: value for name, value in logged.items() if name.startswith("train/")})
        means.append({name: np.mean([t[name] for t in told if name in t]) for name in told[-1]})
    assert set(means[0]) == {f"train/{name}" for name in ("loss", "excess_loss", "consistency", "shortfall", "points")}
    assert means[1] == pytest.approx(means[0], rel=1e-5)


def test_a_run_with_pairs_at_once_ends_at_the_weights_of_one_without(tmp_path):
    ends = []
    for at_once in (1, 3):
        torch.manual_seed(0)
        module = make_module(pairs_at_once=at_once)
        trainer = fit(module, make_data(tmp_path), steps=3, accumulate_grad_batches=3)
        assert trainer.global_step == 3
        ends.append(torch.cat([weights.detach().flatten() for weights in module.parameters()]))
    torch.testing.assert_close(*ends, rtol=1e-4, atol=1e-5)


def test_the_network_can_not_see_more_pairs_at_once_than_a_step_has(tmp_path):
    with pytest.raises(BadInputError, match=r"module\.pairs_at_once is 3, .*accumulate_grad_batches=2 pairs"):
        fit(make_module(pairs_at_once=3), make_data(tmp_path), steps=3, accumulate_grad_batches=2)
    with pytest.raises(BadInputError, match="pairs_at_once of the module counts pairs, from 1, and is 0"):
        make_module(pairs_at_once=0)


@pytest.mark.parametrize("key", ["consistency", "consistency_beta", "ranking"])
def test_weights_can_not_be_negative(key):
    with pytest.raises(BadInputError, match=f"{key}.* can't be negative"):
        make_module(**{key: -1})


def test_the_loss_adds_what_the_best_points_lack_in_inliers():
    module, weightless = (make_module(ranking=weight, consistency=0) for weight in (30, 0))
    weightless.load_state_dict(module.state_dict())
    logged = Logged(module)
    Logged(weightless)
    places = np.arange(12), np.arange(12)[::-1] * 3
    sides = side(*places, [GOOD] * 12), side(*places, [GOOD] * 12)
    pair = hand_made(*sides, range(12), range(12))
    losses = [m.training_step(pair, 0) for m in (module, weightless)]
    logits = logits_at(module.network, (pair.image0, pair.image1), [sides[0][0]] * 2, "dense")
    same = torch.arange(12)
    expected = ranking_loss(*logits, same, same, torch.full((12,), 12))
    assert 0.01 < expected.item() < 1
    assert float(losses[0] - losses[1]) == pytest.approx(30 * expected.item(), rel=1e-4)
    assert logged["train/shortfall"] == pytest.approx(float(expected), rel=1e-5)


def test_an_inlier_to_some_degree_counts_as_both():
    module = make_module(consistency=0)
    Logged(module)
    losses = []
    for share in (0, 0.25, 1):
        points, labels = side([3], [4], [GOOD])
        pair = hand_made((points, replace(labels, share=np.full(1, share, np.float32))), side([], [], []))
        losses.append(float(module.training_step(pair, 0)))
    assert losses[1] == pytest.approx(0.75 * losses[0] + 0.25 * losses[2], rel=1e-5)


def test_the_gradient_moves_inliers_up_and_others_down():
    module = make_module(optimizer=partial(torch.optim.SGD, lr=1e-3))
    Logged(module)
    pair = hand_made(side([5, 30], [6, 40], [GOOD, ALONE]), side([], [], []))
    before = module(pair.image0)[0, 0].detach()
    optimizer = module.make_optimizer(module.network.parameters())
    for _ in range(20):
        optimizer.zero_grad()
        module.training_step(pair, 0).backward()
        optimizer.step()
    after = module(pair.image0)[0, 0].detach()
    assert after[5, 6] - before[5, 6] > after[30, 40] - before[30, 40]


@pytest.mark.parametrize(
    "sides",
    [
        (side([], [], []), side([], [], [])),
        (side([3, 4], [9, 30], [ALONE, FAR]), side([3], [3], [ALONE])),
        (side([3], [9], [UNKNOWN]), side([], [], [])),
    ],
    ids=["no points", "no inlier", "nothing known"],
)
def test_poor_pairs_are_legal(sides):
    module = make_module()
    logged = Logged(module)
    loss = module.training_step(hand_made(*sides), 0)
    assert torch.isfinite(loss)
    if loss.requires_grad:
        loss.backward()
    assert logged["labels/inlier"] == 0
    assert np.isfinite(list(logged.values())).all()


def test_a_run_on_a_scene_without_any_point_or_inlier(tmp_path):
    grey = ArraySequence([np.full((60, 70), 90, np.uint8) for _ in range(8)], "grey", [np.eye(3)] * 8)
    module = make_module()
    fit(module, make_data(tmp_path, grey), steps=3)
    assert all(torch.isfinite(p).all() for p in module.parameters())


def test_a_run_changes_the_weights_and_tells_where_inliers_come_from(tmp_path):
    module, watch = make_module(), Watch()
    before = [p.detach().clone() for p in module.parameters()]
    fit(module, make_data(tmp_path), steps=3, callbacks=[watch])
    assert any(not torch.equal(a, b) for a, b in zip(before, module.parameters(), strict=True))
    rates = [watch.metrics[f"labels/{name}"] for name in ("inlier", "unmatched", "lost", "far")]
    assert sum(rates) == pytest.approx(1)
    assert watch.metrics["inlier_rate/data"] == watch.metrics["labels/inlier"] > 0.1
    assert 0 < watch.metrics["train/points"] <= 80


class Weights(L.Callback):
    """The last layer's bias after every step of the optimiser."""

    def __init__(self) -> None:
        self.biases: list[float] = []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        if trainer.global_step > len(self.biases):
            self.biases.append(float(pl_module.network.layers[-1].bias))


@pytest.mark.parametrize("pairs", [1, 2])
def test_the_teacher_is_the_mean_of_the_weights_over_the_steps(tmp_path, pairs):
    module, seen = make_module(teacher_decay=0.75), Weights()
    fit(module, make_data(tmp_path), steps=4, callbacks=[seen], accumulate_grad_batches=pairs)
    mean, *later = seen.biases
    for bias in later:
        mean = 0.75 * mean + 0.25 * bias
    assert len(later) == 3
    assert len(set(seen.biases)) == 4
    assert float(module.teacher.module.layers[-1].bias) == pytest.approx(mean, abs=1e-6)


def test_points_of_images_of_any_sizes_are_those_of_each_by_itself(monkeypatch):
    module = make_module()
    module._trainer = SimpleNamespace(precision_plugin=SimpleNamespace(forward_context=contextlib.nullcontext))
    seen, octave = [], module.network.octave
    monkeypatch.setattr(module.network, "octave", lambda image: seen.append(tuple(image.shape)) or octave(image))
    images = [texture(60, 80, seed=0), texture(48, 64, seed=1), texture(60, 80, seed=2), texture(48, 64, seed=3)]
    together = module.select_to_train(images)
    assert seen == [(2, 1, 60, 80), (2, 1, 48, 64)]
    for image, points in zip(images, together, strict=True):
        (alone,) = module.select_to_train([image])
        assert len(alone) > 10
        np.testing.assert_array_equal(points.row, alone.row)
        np.testing.assert_array_equal(points.column, alone.column)
        np.testing.assert_allclose(points.keypoints.score, alone.keypoints.score, atol=1e-6)


def test_the_teacher_selects_what_is_labelled_and_the_network_what_counts():
    module = make_module(teacher_decay=0.9)
    module._trainer = SimpleNamespace(precision_plugin=SimpleNamespace(forward_context=contextlib.nullcontext))
    image = texture(60, 80)
    before = module.select(image).keypoints.xy
    with torch.no_grad():
        for weight in module.network.parameters():
            weight.neg_()
    (labelled,) = module.select_to_train([image])
    np.testing.assert_array_equal(labelled.keypoints.xy, before)
    assert not np.array_equal(module.select(image).keypoints.xy, before)
    moved = list(module.trained)
    assert len(moved) == len(list(module.network.parameters()))
    assert all(weight.requires_grad for weight in moved)


@pytest.mark.parametrize("decay", [-0.1, 1.0, float("nan")])
def test_a_decay_is_from_0_to_less_than_1(decay):
    with pytest.raises(BadInputError, match="teacher_decay of the module is"):
        make_module(teacher_decay=decay)


def test_bf16_runs(tmp_path):
    module, watch = make_module(), Watch()
    fit(module, make_data(tmp_path), steps=2, callbacks=[watch], precision="bf16-mixed")
    assert np.isfinite(watch.metrics["train/loss"])
    assert all(p.dtype == torch.float32 and torch.isfinite(p).all() for p in module.parameters())


class TwoSources:
    """A module outside of a trainer, whose pairs are of two sources; the losses that are told and weighed."""

    def __init__(self, **options) -> None:
        torch.manual_seed(0)
        self.module = make_module(**options)
        sources = [SimpleNamespace(name="city", weight=3.0), SimpleNamespace(name="desk", weight=1.0)]
        self.logged = Logged(self.module)
        strategy = SimpleNamespace(reduce=lambda sums, reduce_op: sums if reduce_op == "sum" else None)
        self.module._trainer.strategy = strategy
        self.module._trainer.datamodule = SimpleNamespace(sources=sources)
        self.module._trainer.accumulate_grad_batches = self.module.pairs_at_once
        self.module.on_fit_start()

    def step(self, *pairs) -> list[float]:
        """The losses of the pairs of a step, as they go into its gradient."""
        losses = [float(self.module.training_step(pair, at).detach()) for at, pair in enumerate(pairs)]
        source_focus = self.module._source_focus
        if source_focus is not None:
            source_focus.learn(self.module._mean_losses(["city", "desk"]))
        return losses


EASY, HARD = hand_made(*ONE_PAIR), replace(hand_made(*ANOTHER), source=1)


def test_the_loss_of_a_pair_is_weighed_by_its_source():
    plain, focused = TwoSources(), TwoSources(focus="difficulty")
    easy, hard = plain.step(EASY, HARD)
    told = [float(focused.module._loss(p, *logits_of(focused.module, p)).told["loss"]) for p in (EASY, HARD)]
    assert told[0] != pytest.approx(told[1], rel=0.02)
    for _ in range(FAST):
        assert focused.step(EASY, HARD) == pytest.approx([easy, hard])  # not known yet
    mean = (3 * told[0] + told[1]) / 4
    assert focused.step(EASY, HARD) == pytest.approx([easy * told[0] / mean, hard * told[1] / mean], rel=1e-4)
    assert focused.logged["source_weight/desk"] == pytest.approx(told[1] / mean, rel=1e-4)
    assert focused.logged["train/loss"] == pytest.approx(told[1], rel=1e-5)  # what is told stays what it was
    assert plain.step(EASY, HARD) == pytest.approx([easy, hard])
    assert "source_weight/desk" not in plain.logged


def logits_of(module, pair):
    images, points = [pair.image0, pair.image1], [pair.points0, pair.points1]
    return logits_at(module.network, images, points, "dense")


def test_a_step_of_several_pairs_of_a_source_counts_their_mean_and_pairs_without_truth_nothing():
    focused = TwoSources(focus="difficulty")
    unknown = replace(hand_made(side([3], [4], [UNKNOWN]), side([5], [7], [UNKNOWN])), source=1)
    focused.step(EASY, hand_made(*ANOTHER), unknown)
    losses = focused.module._source_focus.losses
    told = [float(focused.module._loss(p, *logits_of(focused.module, p)).told["loss"]) for p in (EASY, HARD)]
    assert losses["city"].slow == pytest.approx(np.mean(told), rel=1e-5)
    assert (losses["city"].steps, losses["desk"].steps) == (1, 0)


def test_pairs_seen_at_once_are_weighed_each_by_its_source():
    one_by_one, together = TwoSources(focus="difficulty"), TwoSources(focus="difficulty", pairs_at_once=2)
    for _ in range(FAST + 1):
        alone, (waits, both) = one_by_one.step(HARD, EASY), together.step(HARD, EASY)
        assert waits == 0
        assert both == pytest.approx(sum(alone), rel=1e-4)
    assert one_by_one.logged["source_weight/desk"] != pytest.approx(1, abs=0.01)


def test_another_focus_is_refused():
    with pytest.raises(BadInputError, match="focus of the module is hard: give difficulty or progress, or null"):
        make_module(focus="hard")
