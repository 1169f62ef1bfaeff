import numpy as np
import pytest
from overlapping_sources import assert_same, sampler_of, sources
from textured_scenes import flight

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.sampler import FixedPairs, PairChoice


@pytest.mark.parametrize("weights", [(1.0, 3.0), (2.0, 1.0, 1.0), (0.1, 10.0)])
def test_sources_are_drawn_by_weight(weights):
    n = 2000
    sampler = sampler_of(sources(weights))
    counts = np.bincount([sampler.draw(0, i)[0] for i in range(n)], minlength=len(weights))
    for count, share in zip(counts, np.array(weights) / sum(weights), strict=True):
        assert abs(count - n * share) < 4 * np.sqrt(n * share * (1 - share)) + 1


def test_the_source_tells_nothing_about_the_pair():
    data = [Source([flight(40, size=(8, 8))]) for _ in range(2)]  # two equal sources
    sampler = sampler_of(data)
    drawn = [sampler.draw(0, i) for i in range(3000)]
    first = np.array([min(choice.index0, choice.index1) for _, choice in drawn])
    of_one = np.array([at == 0 for at, _ in drawn])
    spread = first.std() * np.sqrt(4 / len(first))
    assert abs(first[of_one].mean() - first[~of_one].mean()) < 4 * spread


def test_a_draw_depends_on_seed_epoch_and_index_only():
    data = sources()
    one, other, another_seed = sampler_of(data), sampler_of(data), sampler_of(data, seed=4)
    draws = [one.draw(1, i) for i in range(30)]
    assert [other.draw(1, i) for i in reversed(range(30))] == draws[::-1]
    assert [another_seed.draw(1, i) for i in range(30)] != draws
    assert [one.draw(2, i) for i in range(30)] != draws


def test_every_source_needs_a_pair():
    data = [Source([flight(3, name="good")]), Source([flight(1, name="lonely")])]
    with pytest.raises(BadInputError, match="no two frames of lonely overlap"):
        sampler_of(data)


def test_fixed_pairs_are_different_and_stable():
    chosen = sampler_of(sources()).fixed(20)
    assert len(set(chosen)) == len(chosen) == 20
    assert sampler_of(sources()).fixed(20) == chosen
    assert sampler_of(sources()).fixed(5) == chosen[:5]


def test_all_pairs_are_fixed_where_there_are_not_more_and_their_order_makes_no_other_pair():
    few = sampler_of([Source([flight(3)])]).fixed(50)
    assert sorted(sorted((choice.index0, choice.index1)) for _, choice in few) == [[0, 1], [0, 2], [1, 2]]
    frames = 5, 4, 6  # of the sequences of both sources
    everything = sum(n * (n - 1) // 2 for n in frames)
    for count in (everything - 1, everything, everything + 1):
        assert len(sampler_of(sources()).fixed(count)) == min(count, everything)
    directions = [choice.index0 < choice.index1 for _, choice in sampler_of(sources()).fixed(everything)]
    assert 0 < sum(directions) < everything


def test_drawing_stops_when_there_are_no_other_pairs(monkeypatch):
    sampler, drawn = sampler_of([Source([flight(3)])]), []
    draw = sampler.draw
    monkeypatch.setattr(sampler, "draw", lambda *at: drawn.append(at) or draw(*at))
    assert len(sampler.fixed(10_000)) == 3
    assert len(drawn) < 100


def test_fixed_pairs_are_unaugmented_and_the_same_every_time():
    data = sources()
    choices = sampler_of(data).fixed(6)
    pairs = FixedPairs(data, choices, HomographyInliers())
    assert len(pairs) == 6
    for i, (at, choice) in enumerate(choices):
        assert_same(pairs[i], pairs[i])
        sequence = data[at].sequences[choice.sequence]
        assert pairs[i].source == at
        np.testing.assert_array_equal(pairs[i].pair.image0, sequence.frames[choice.index0])
        np.testing.assert_array_equal(pairs[i].pair.image1, sequence.frames[choice.index1])
        assert len(pairs[i].pair.frames) == 2


def test_each_source_draws_among_its_own_sequences():
    sampler = sampler_of(sources())
    drawn = [sampler.draw(0, i) for i in range(400)]
    assert {(at, choice.sequence) for at, choice in drawn} == {(0, 0), (0, 1), (1, 0)}
    longest = {(0, 0): 5, (0, 1): 4, (1, 0): 6}  # frames of each sequence
    for key, frames in longest.items():
        assert max(max(c.index0, c.index1) for at, c in drawn if (at, c.sequence) == key) == frames - 1


def test_only_usable_pairs_are_fixed_and_each_is_asked_once():
    asked = []

    def near(source: int, choice: PairChoice) -> bool:
        asked.append((source, choice))
        return abs(choice.index0 - choice.index1) == 1

    chosen = sampler_of(sources()).fixed(8, near)
    assert len(chosen) == 8
    assert all(abs(choice.index0 - choice.index1) == 1 for _, choice in chosen)
    assert len({(at, c.sequence, frozenset((c.index0, c.index1))) for at, c in asked}) == len(asked)
    assert sampler_of(sources()).fixed(8, lambda source, choice: False) == []


def test_no_pairs_asked_for():
    assert sampler_of(sources()).fixed(0) == []
    assert len(FixedPairs(sources(), [], KltInliers())) == 0


def test_frames_between_are_read_where_the_source_s_own_check_or_the_default_needs_them():
    pairs = FixedPairs(sources(), [(0, PairChoice(1, 0, 3)), (1, PairChoice(0, 0, 3))], KltInliers())
    assert [len(pairs[i].pair.frames) for i in range(2)] == [4, 2]  # KLT, and the second source's homographies
    assert [pairs[i].skipped for i in range(2)] == [(), ()]
