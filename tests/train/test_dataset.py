import dataclasses

import numpy as np
import pytest
from textured_scenes import ArraySequence, flight, texture
from torch.utils.data import DataLoader

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.pairs.sampler import PairChoice
from sips_lit.pairs.source_pairs import FixedPairs, SourcePair, SourceSampler
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import PackedPairs, TrainingPairs, pack, unpack
from sips_lit.types import FramePair


def all_overlap(length: int) -> OverlapIndex:
    """Every frame sees all later ones."""
    counts = np.arange(length)[::-1]
    return OverlapIndex(
        np.full(counts.sum(), 9, np.uint16), np.concatenate([[0], np.cumsum(counts)]), np.full(length, 9)
    )


def sources(weights: tuple[float, ...] = (1.0, 3.0)) -> list[Source]:
    """The first source has two sequences, the others one."""
    made = [Source([flight(5, name="a"), flight(4, seed=1, name="b")], weights[0], name="first")]
    made += [Source([flight(6, seed=2 + i, name=f"c{i}")], w, HomographyInliers()) for i, w in enumerate(weights[1:])]
    return made


def sampler_of(data: list[Source], seed: int = 3) -> SourceSampler:
    return SourceSampler(data, [all_overlap(len(s)) for source in data for s in source.sequences], 0.5, seed)


def training_pairs(length: int = 12, seed: int = 3) -> TrainingPairs:
    data = sources()
    return TrainingPairs(data, sampler_of(data, seed), KltInliers(), Augmentation(), length)


def assert_same(a: SourcePair, b: SourcePair) -> None:
    assert a.source == b.source
    for field in dataclasses.fields(FramePair):
        one, other = getattr(a.pair, field.name), getattr(b.pair, field.name)
        if field.name == "frames":
            assert len(one) == len(other)
            assert all(np.array_equal(x, y) for x, y in zip(one, other, strict=True))
        else:
            np.testing.assert_array_equal(one, other)


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
    few = sampler_of([Source([flight(3)])]).fixed(50)
    assert {choice for _, choice in few} == {PairChoice(0, i, j) for i in range(3) for j in range(3) if i != j}


def test_pair_i_is_the_same_in_any_order():
    pairs, again = training_pairs(), training_pairs()
    backwards = {i: again[i] for i in reversed(range(12))}
    for i in range(12):
        assert_same(pairs[i], backwards[i])
    images = {pairs[i].pair.image0.tobytes() for i in range(12)}
    assert len(images) == 12
    other_seed = training_pairs(seed=5)
    assert [other_seed[i].pair.name for i in range(12)] != [pairs[i].pair.name for i in range(12)]


@pytest.mark.parametrize("workers", [0, 2])
def test_pair_i_is_the_same_in_any_worker(workers):
    loader = DataLoader(PackedPairs(training_pairs()), batch_size=None, num_workers=workers)
    loaded, expected = [unpack(packed) for packed in loader], training_pairs()
    assert len(loaded) == 12
    for i, item in enumerate(loaded):
        assert_same(item, expected[i])


def test_frames_between_are_read_where_labels_need_them():
    data = sources()
    pairs = TrainingPairs(data, sampler_of(data), KltInliers(), None, 40)
    for item in (pairs[i] for i in range(40)):
        between = abs(item.pair.index1 - item.pair.index0) + 1
        assert len(item.pair.frames) == (between if item.source == 0 else 2)
        np.testing.assert_array_equal(item.pair.image1, item.pair.frames[-1])


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


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_packing_keeps_images_of_any_sizes(frames):
    images = [texture(20 + 3 * i, 31 - 2 * i, i) for i in range(frames + 2)]
    item = SourcePair(FramePair("a:1-9", 1, 9, tuple(images[:-2]), images[-2], images[-1], np.eye(3)), 4)
    assert_same(unpack(pack(item)), item)


def test_packing_copies_the_pixels():
    image = texture(20, 30)
    packed = pack(SourcePair(FramePair("a", 0, 1, (image, image), image, image), 0))
    before = image.copy()
    image[:] = 0
    np.testing.assert_array_equal(unpack(packed).pair.image0, before)
    assert packed["item"].pair.image0.size == 0  # nothing passes twice
    assert packed["pixels"].numel() == 4 * 600


class Broken(ArraySequence):
    def frame(self, index):
        raise BadInputError(f"frame {index} of clip.mp4 cannot be decoded: convert the video")


@pytest.mark.parametrize("workers", [0, 1])
def test_errors_of_the_user_pass_through_workers_word_by_word(workers):
    data = [Source([Broken(flight(3).frames, "clip")])]
    pairs = PackedPairs(FixedPairs(data, [(0, PairChoice(0, 1, 2))], KltInliers()))
    assert len(pairs) == 1
    (packed,) = DataLoader(pairs, batch_size=None, num_workers=workers)
    with pytest.raises(BadInputError) as caught:
        unpack(packed)
    assert str(caught.value) == "frame 1 of clip.mp4 cannot be decoded: convert the video"


def test_other_errors_are_not_hidden():
    data = [Source([flight(3)])]
    with pytest.raises(IndexError):
        PackedPairs(FixedPairs(data, [(0, PairChoice(0, 1, 9))], KltInliers()))[0]
