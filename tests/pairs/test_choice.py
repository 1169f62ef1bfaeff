import numpy as np
import pytest
from textured_scenes import ArraySequence, Damaged, flight, texture

from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.source import Source
from sips_lit.pairs.choice import choose_pairs, write_pair_file

A, B, C = (flight(7, size=(96, 80), seed=seed, name=name) for seed, name in enumerate("abc"))
SOURCES = [Source([A]), Source([B, C], weight=2)]


@pytest.fixture(scope="module")
def indexes(tmp_path_factory):
    """Indexes of the sources, measured once."""
    return tmp_path_factory.mktemp("indexes")


def test_random_pairs_are_fixed_by_the_seed(indexes):
    listed = choose_pairs(SOURCES, indexes, pairs=12, overlap=0.5, seed=3)
    names = [f"{'abc'[p.sequence]}:{p.index0}-{p.index1}" for p in listed]
    assert len(set(names)) == 12
    assert {name[0] for name in names} == set("abc")
    assert listed == choose_pairs(SOURCES, indexes, pairs=12, overlap=0.5, seed=3)
    assert listed[:4] == choose_pairs(SOURCES, indexes, pairs=4, overlap=0.5, seed=3)
    assert listed != choose_pairs(SOURCES, indexes, pairs=12, overlap=0.5, seed=4)


def test_fewer_pairs_than_asked_for(tmp_path):
    with pytest.warns(InputWarning, match=r"^500 pairs are asked for, and only 3 different ones overlap by 0\.1$"):
        assert len(choose_pairs([Source([flight(3)])], tmp_path, pairs=500, overlap=0.1)) == 3


def test_no_pair_overlaps(tmp_path):
    cuts = ArraySequence([texture(80, 96, i) for i in range(5)], "cuts")
    with pytest.raises(BadInputError, match=r"no two frames of cuts overlap by 0\.5"):
        choose_pairs([Source([cuts])], tmp_path, pairs=5)


def test_evaluations_need_every_frame(tmp_path):
    walk = Damaged(flight(9).frames, "walk")
    walk.bad = (3,)
    sources = [Source([flight(8, size=(96, 80), known=False), walk])]
    with pytest.raises(BadInputError, match=r"an evaluation needs every frame, but 3\.png is damaged"):
        choose_pairs(sources, tmp_path, pairs=5, overlap=0.4)


def test_overlap_is_told(indexes):
    listed = choose_pairs(SOURCES, indexes, pairs=12, overlap=0.5)
    overlap = np.array([p.overlap for p in listed])
    assert (overlap >= 0.5).all()
    assert (overlap <= 1).all()
    span = np.array([abs(p.index0 - p.index1) for p in listed])
    assert overlap[span == span.max()].mean() < overlap[span == span.min()].mean()


def test_the_first_with_all_others(tmp_path):
    listed = choose_pairs(SOURCES, tmp_path, kind="first_to_others")
    assert [(p.sequence, p.index0, p.index1) for p in listed] == [(s, 0, i) for s in range(3) for i in range(1, 7)]
    assert not list(tmp_path.iterdir())  # nothing to index


def test_a_file_wins(indexes, tmp_path):
    listed = choose_pairs(SOURCES, indexes, pairs=5)
    write_pair_file(tmp_path / "p.csv", [A, B, C], listed)
    assert choose_pairs(SOURCES, indexes, pairs=3, seed=9, pairs_file=tmp_path / "p.csv") == listed


@pytest.mark.parametrize(("options", "words"), [({"pairs": 0}, "pairs is 0"), ({"kind": "all"}, "kind is all: give")])
def test_impossible(tmp_path, options, words):
    with pytest.raises(BadInputError, match=words):
        choose_pairs(SOURCES, tmp_path, **options)


def test_pairs_of_middle_difficulty_and_how_far_they_are_apart(indexes):
    listed = choose_pairs(SOURCES, indexes, pairs=6, overlap=0.5, overlap_below=0.8)
    assert all(0.5 <= pair.overlap < 0.8 for pair in listed)
    sequences = [sequence for source in SOURCES for sequence in source.sequences]
    for pair in listed:
        H = sequences[pair.sequence].homography(pair.index0, pair.index1)
        if H is not None:
            moved = H @ [80, 60, 1]
            assert pair.pixels == pytest.approx(np.hypot(*(moved[:2] / moved[2] - [80, 60])), rel=0.35)
    with pytest.warns(InputWarning, match=r"different ones overlap by 0\.5 and less than 0\.8$"):
        choose_pairs(SOURCES, indexes, pairs=10_000, overlap=0.5, overlap_below=0.8)
