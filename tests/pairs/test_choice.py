import numpy as np
import pytest
from textured_scenes import flight

from sips_lit.errors import BadInputError
from sips_lit.evaluate.pairs import draw_pairs
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.pairs.choice import choose_pairs
from sips_lit.pairs.pair_file import write_pair_file

A, B, C = (flight(7, size=(96, 80), seed=seed, name=name) for seed, name in enumerate("abc"))
SOURCES = [Source([A]), Source([B, C], weight=2)]


def test_random_pairs_are_those_of_an_evaluation(tmp_path):
    """Two commands with the same seed measure the same pairs."""
    listed = choose_pairs(SOURCES, tmp_path, pairs=12, overlap=0.5, seed=3)
    names = [f"{'abc'[p.sequence]}:{p.index0}-{p.index1}" for p in listed]
    drawn = draw_pairs(SOURCES, HomographyInliers(), tmp_path, 12, 0.5, 3)
    assert names == [pair.name for pair, _ in drawn]
    assert len(set(names)) == 12
    assert {name[0] for name in names} == set("abc")
    assert listed == choose_pairs(SOURCES, tmp_path, pairs=12, overlap=0.5, seed=3)
    assert listed != choose_pairs(SOURCES, tmp_path, pairs=12, overlap=0.5, seed=4)


def test_overlap_is_told(tmp_path):
    listed = choose_pairs(SOURCES, tmp_path, pairs=12, overlap=0.5)
    overlap = np.array([p.overlap for p in listed])
    assert (overlap >= 0.5).all()
    assert (overlap <= 1).all()
    span = np.array([abs(p.index0 - p.index1) for p in listed])
    assert overlap[span == span.max()].mean() < overlap[span == span.min()].mean()


def test_the_first_with_all_others(tmp_path):
    listed = choose_pairs(SOURCES, tmp_path, kind="first_to_others")
    assert [(p.sequence, p.index0, p.index1) for p in listed] == [(s, 0, i) for s in range(3) for i in range(1, 7)]
    assert not list(tmp_path.iterdir())  # nothing to index


def test_a_file_wins(tmp_path):
    listed = choose_pairs(SOURCES, tmp_path, pairs=5)
    write_pair_file(tmp_path / "p.csv", [A, B, C], listed)
    assert choose_pairs(SOURCES, tmp_path, pairs=3, seed=9, pairs_file=tmp_path / "p.csv") == listed


@pytest.mark.parametrize(("options", "words"), [({"pairs": 0}, "pairs is 0"), ({"kind": "all"}, "kind is all: give")])
def test_impossible(tmp_path, options, words):
    with pytest.raises(BadInputError, match=words):
        choose_pairs(SOURCES, tmp_path, **options)
