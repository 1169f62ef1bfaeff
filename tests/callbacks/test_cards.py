import re

import pytest

from sips_lit.callbacks.cards import CARDS, LAYOUT, RUN_METRICS, Card, card_of


def test_cards_are_told_apart_and_explained():
    tags = [card.tag for card in CARDS.values()]
    assert len(set(tags)) == len(tags)
    assert all(card.text.endswith(".") and len(card.text) > 30 for card in CARDS.values())


def test_the_numbers_that_judge_a_run_come_first():
    assert sorted(card.tag for card in CARDS.values())[:3] == [
        card_of(name).tag for name in ("val/succinctness_auc", "val/n_at_80", "val/ece")
    ]


@pytest.mark.parametrize(
    ("name", "tag"),
    [
        ("inlier_rate/city", "3_labels/inlier_rate/city"),
        ("source_weight/city", "3_labels/source_weight/city"),
        ("lr-Adam", "5_run/lr-Adam"),
        ("val/pair_3", "1_val/pair_3"),
        ("val/inlier_ratio", "1_val/inlier_ratio"),  # of the user's own
        ("train/own", "2_train/own"),
        ("own/number", "own/number"),
        ("number", "number"),
    ],
)
def test_a_name_that_is_not_listed_stands_with_its_group(name, tag):
    card = card_of(name)
    assert card.tag == tag
    assert bool(card.text) == (name in ("inlier_rate/city", "source_weight/city", "lr-Adam", "val/pair_3"))


def test_what_is_not_known_has_no_text():
    assert card_of("own/number") == Card("own/number", "")


def test_charts_and_columns_name_tags_that_exist():
    tags = [card.tag + "city" * card.tag.endswith("/") for card in CARDS.values()]
    for patterns in (patterns for row in LAYOUT.values() for patterns in row.values()):
        for pattern in patterns:
            assert any(re.match(pattern, tag) for tag in tags), pattern
    assert set(RUN_METRICS) <= CARDS.keys()
