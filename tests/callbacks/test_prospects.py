from types import SimpleNamespace

import numpy as np
import pytest
from validation_pairs import TRAINER, Module, verified

from sips_lit.callbacks.prospects import Prospects
from sips_lit.detect.selection import SelectedPoints, image_tensor
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.matching.mutual_nearest import MutualLifetimes
from sips_lit.train.loader import LabelledPair
from sips_lit.types import Keypoints, Reason

NO_MATCHES = MutualLifetimes(*[np.zeros(0, np.int64)] * 4)


def labelled(points: int, *reasons: Reason) -> LabelledPair:
    """A pair with so many points in each image; the first have these reasons, the rest no match."""
    reason = np.full(points, Reason.UNMATCHED, np.uint8)
    reason[: len(reasons)] = reasons
    zeros, one = np.zeros(points, np.int64), np.ones(points, np.float32)
    selected = SelectedPoints(Keypoints(np.zeros((points, 2), np.float32), one, one), zeros, zeros, zeros)
    labels = PointLabels(reason == Reason.INLIER, reason != Reason.UNKNOWN, reason, np.float32(reason == Reason.INLIER))
    image = image_tensor(np.zeros((4, 4), np.uint8))
    return LabelledPair(image, image, selected, selected, labels, labels, NO_MATCHES, 0, "pair")


def train(callback: Prospects, *pairs: LabelledPair) -> None:
    for index, pair in enumerate(pairs):
        callback.on_train_batch_end(TRAINER, Module(), None, pair, index)


def validate(callback: Prospects, *pairs) -> None:
    callback.on_validation_start(TRAINER, Module())
    for index, pair in enumerate(pairs):
        callback.on_validation_batch_end(TRAINER, Module(), pair, None, index)
    callback.on_validation_epoch_end(TRAINER, Module())


GOOD = labelled(30, Reason.INLIER)


def test_a_training_that_works_says_nothing(recwarn):
    callback = Prospects(k=10, n_max=50, stretch=3)
    train(callback, labelled(30), labelled(30), GOOD, labelled(30), labelled(30), GOOD, labelled(9), labelled(9), GOOD)
    validate(callback, verified(0), verified(12))
    assert callback.failure is None
    assert not recwarn.list


def test_images_without_points():
    callback = Prospects(k=10, stretch=3)
    with pytest.warns(
        InputWarning, match=r"images of 3 training pairs in a row gave fewer than 10 points: .*sips-data check"
    ):
        train(callback, *[labelled(9, Reason.INLIER)] * 3)
    with pytest.warns(InputWarning, match=r"no validation pair have more than 9 points, and k = 10 inliers are needed"):
        validate(callback, verified(9, n=9), verified(0, n=8))


def test_labels_without_inliers_and_why():
    callback = Prospects(stretch=4)
    with pytest.warns(
        InputWarning, match=r"4 training pairs in a row had no inlier \(.*75% have no match, 25% match too far"
    ):
        train(callback, GOOD, *[labelled(20, *[Reason.FAR] * 5)] * 4)


def test_a_stretch_is_told_once(recwarn):
    train(Prospects(stretch=2), *[labelled(20)] * 9)
    assert len(recwarn.list) == 1


def test_pairs_that_have_some_inliers_but_not_enough():
    callback = Prospects(k=10, n_max=50)
    with pytest.warns(
        InputWarning, match=r"step 12: no validation pair has k = 10 inliers .* the best has 7: train longer"
    ):
        validate(callback, verified(7), verified(3, seed=1))
    validate(callback, verified(12))
    assert callback.failure is None


def test_k_inliers_only_at_n_max_are_an_auc_of_zero():
    callback = Prospects(k=10, n_max=10)
    with pytest.warns(InputWarning, match="no validation pair has k = 10 inliers among fewer than n_max = 10"):
        validate(callback, verified(10))


@pytest.mark.filterwarnings("ignore::sips_lit.errors.InputWarning")
def test_it_ends_only_what_never_had_an_inlier():
    barren = [labelled(20, Reason.LOST)] * 3
    hopeless = Prospects(stretch=3)
    train(hopeless, *barren)
    with pytest.raises(BadInputError, match=r"nothing to learn: 3 training pairs had no inlier, and no validation"):
        validate(hopeless, verified(0), verified(0, seed=1))
    for trained, pairs in (
        ([*barren, GOOD], [verified(0)]),  # training has seen an inlier
        (barren, [verified(1)]),  # validation has
        (barren[:2], [verified(0)]),  # too early
    ):
        callback = Prospects(stretch=3)
        train(callback, *trained)
        validate(callback, *pairs)
        assert callback.failure is not None


def test_no_validation_pairs_and_repeated_ones_say_nothing(recwarn):
    callback = Prospects()
    validate(callback)
    validate(callback, None)
    assert callback.failure is None
    assert not recwarn.list


def test_only_the_first_process_warns(recwarn):
    callback, other = Prospects(stretch=1), SimpleNamespace(global_step=1, is_global_zero=False)
    callback.on_train_batch_end(other, Module(), None, labelled(3), 0)
    assert not recwarn.list
