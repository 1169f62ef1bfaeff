"""The cards of TensorBoard: under which tag each number or picture of a run stands, and what it means.

TensorBoard sorts tags by name and opens the first two groups, so groups are numbered by use, and so are the three numbers
that judge a run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Card:
    """``tag`` in TensorBoard, and the ``text`` behind its (i); empty for what only the user knows."""

    tag: str
    text: str = ""


CARDS: Final[dict[str, Card]] = {
    "val/succinctness_auc": Card(
        "1_val/1_succinctness_auc",
        "Area under the succinctness curve: mean over n below n_max of the share of validation pairs that have k inliers "
        "with their n best points. Higher is better; best.ckpt is chosen by it.",
    ),
    "val/n_at_80": Card(
        "1_val/2_n_at_80",
        "Points per image with which 80 % of the validation pairs have k inliers. Lower is better; there is no value while "
        "fewer pairs get there within n_max points.",
    ),
    "val/ece": Card(
        "1_val/3_ece",
        "Expected calibration error: mean distance of the predicted probability from the frequency of inliers, over bins "
        "weighted by their points. 0: probabilities come true.",
    ),
    "val/n_median": Card("1_val/n_median", "Points per image with which half of the validation pairs have k inliers."),
    "val/failure_rate": Card("1_val/failure_rate", "Share of the validation pairs without k inliers in n_max points."),
    "val/mce": Card(
        "1_val/mce", "Maximum calibration error: the distance in the worst bin, however few points it has."
    ),
    "val/brier": Card(
        "1_val/brier",
        "Brier score: mean squared difference of predicted probability and outcome (0 or 1). It falls with better "
        "probabilities and with points that are easier to tell apart.",
    ),
    "val/curve": Card(
        "1_val/curve", "Succinctness curve: share of the validation pairs that have k inliers with n points."
    ),
    "val/reliability": Card(
        "1_val/reliability",
        "Frequency of inliers (with its 95 % interval) in bins of the predicted probability, above the number of points. On "
        "the diagonal probabilities come true; below it the network promises too much.",
    ),
    "val/covariance_error": Card(
        "1_val/covariance_error",
        "Mean distance of the share of residuals in an ellipse from its probability. 0: covariances are right.",
    ),
    "val/covariance_scale": Card(
        "1_val/covariance_scale", "Factor that the covariances need, by maximum likelihood. Above 1 they are too small."
    ),
    "val/covariance_nll": Card(
        "1_val/covariance_nll",
        "Mean negative log-likelihood of the residuals under the covariances, in nats, without log(2 pi). Lower is better.",
    ),
    "val/covariance": Card(
        "1_val/covariance",
        "Share of the residuals within the ellipse of each probability. On the diagonal covariances are right; below it "
        "they are too small.",
    ),
    "val/pair_": Card(
        "1_val/pair_",
        "A validation pair, always the same, with its best points and their score maps. A circle is as thick as the point "
        "is probable, its colour says what became of it, lines join inlier matches.",
    ),
    "train/loss": Card(
        "2_train/loss",
        "What is minimised: mean cross-entropy of a selected point (of a pixel in distillation). It moves with the points.",
    ),
    "train/excess_loss": Card(
        "2_train/excess_loss",
        "Loss beyond the least that says nothing: that of always predicting the pair's inlier rate, or in distillation that "
        "of the teacher itself. Below 0 (0 in distillation) is what was learned.",
    ),
    "train/consistency": Card(
        "2_train/consistency", "Distance of the logits of the two points of an inlier match, mean."
    ),
    "train/shortfall": Card("2_train/shortfall", "Share of the best points that are no inliers: what ranking lowers."),
    "train/residuals": Card("2_train/residuals", "Inlier matches of a pair whose residual teaches covariances."),
    "train/logit_difference": Card(
        "2_train/logit_difference", "Distance of the student's logits from the teacher's, mean."
    ),
    "labels/inlier": Card("3_labels/inlier", "Share of the selected points of known truth that are inliers."),
    "labels/unmatched": Card("3_labels/unmatched", "Share of the selected points without a mutual match."),
    "labels/lost": Card(
        "3_labels/lost",
        "Share of the selected points without a correspondence: lost by the tracker, hidden or outside.",
    ),
    "labels/far": Card("3_labels/far", "Share of the selected points whose match is too far from the true place."),
    "inlier_rate/": Card(
        "3_labels/inlier_rate/",
        "Share of inliers on pairs of this source. Near 0: its frames, order or poses don't fit.",
    ),
    "source_weight/": Card(
        "3_labels/source_weight/",
        "What pairs of this source count in the loss where module.focus lets that follow the training. 1: as configured.",
    ),
    "train/points": Card("3_labels/points", "Points that were selected in both images of a pair together."),
    "time/decode": Card("4_time/decode", "Milliseconds in which a loading worker read and augmented the pair."),
    "time/describe": Card(
        "4_time/describe", "Milliseconds in which labelling threads described the points of the pair."
    ),
    "time/match": Card("4_time/match", "Milliseconds in which a labelling thread matched the points of the pair."),
    "time/track": Card(
        "4_time/track", "Milliseconds in which labelling threads tracked the points, or checked them otherwise."
    ),
    "time/select": Card("4_time/select", "Milliseconds in which the network selected the points of the pair."),
    "time/forward": Card("4_time/forward", "Milliseconds of the forward pass at the points; on a GPU of starting it."),
    "time/backward": Card("4_time/backward", "Milliseconds of the backward pass and the optimiser's step."),
    "time/wait_decode": Card(
        "4_time/wait_decode", "Milliseconds in which the network waited for frames: loading is the limit."
    ),
    "time/wait_labels": Card(
        "4_time/wait_labels", "Milliseconds in which the network waited for labels: they are the limit."
    ),
    "lr-": Card("5_run/lr-", "Learning rate of the step that follows."),
    "data/skipped_pairs": Card("5_run/skipped_pairs", "Training pairs left out so far because they can't be read."),
    "data/skipped_frames": Card("5_run/skipped_frames", "Frames left out so far because they can't be read."),
    "best/succinctness_auc": Card("5_run/best_succinctness_auc", "Succinctness AUC of the best validation so far."),
    "best/n_at_80": Card("5_run/best_n_at_80", "Points for 80 % of the pairs in the validation with the best AUC."),
    "best/ece": Card("5_run/best_ece", "Expected calibration error in the validation with the best AUC."),
}
"""By the name that modules and callbacks log; one that ends in ``/``, ``-`` or ``_`` is the beginning of several."""

_BEGINNINGS: Final = tuple(name for name in CARDS if name[-1] in "/-_")
_GROUPS: Final = {"val": "1_val", "train": "2_train", "labels": "3_labels"}


def card_of(name: str) -> Card:
    """The card of a logged name; one of the user's own has no text, and stands in the group that it names."""
    if name in CARDS:
        return CARDS[name]
    for beginning in _BEGINNINGS:
        if name.startswith(beginning):
            card = CARDS[beginning]
            return Card(card.tag + name.removeprefix(beginning), card.text)
    group, slash, rest = name.partition("/")
    return Card(f"{_GROUPS.get(group, group)}{slash}{rest}")


LAYOUT: Final = {
    "Validation": {
        "Succinctness AUC": ["1_val/1_succinctness_auc"],
        "Points needed": ["1_val/2_n_at_80", "1_val/n_median"],
        "Calibration errors": ["1_val/3_ece", "1_val/mce"],
        "Failures": ["1_val/failure_rate"],
    },
    "Training": {
        "Loss": ["2_train/loss", "2_train/excess_loss"],
        "What becomes of the points": ["3_labels/(inlier|unmatched|lost|far)$"],
        "Inliers by source": ["3_labels/inlier_rate/.*"],
        "Weight by source": ["3_labels/source_weight/.*"],
        "Time of a step": ["4_time/(select|forward|backward|wait_decode|wait_labels)$"],
        "Time beside the network": ["4_time/(decode|describe|match|track)$"],
    },
}
"""Charts of the page *Custom Scalars*: titles and patterns of tags, lines that are read together in one chart."""

RUN_METRICS: Final = {"best/succinctness_auc": "best AUC", "best/n_at_80": "n at 80 %", "best/ece": "ECE"}
"""Columns of the table of runs (*HParams*): logged name and title."""
