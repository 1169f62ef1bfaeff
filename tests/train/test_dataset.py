from types import SimpleNamespace

import numpy as np
import pytest
from overlapping_sources import assert_same, sampler_of, sources
from textured_scenes import ArraySequence, flight, texture
from torch.utils.data import DataLoader

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.klt import KltInliers
from sips_lit.pairs.sampler import FixedPairs, PairChoice, SourcePair
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import PackedPairs, TrainingPairs, pack, unpack
from sips_lit.types import FramePair


def training_pairs(length: int = 12, seed: int = 3) -> TrainingPairs:
    data = sources()
    return TrainingPairs(data, sampler_of(data, seed), KltInliers(), Augmentation(), length)


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


def test_a_pair_is_the_one_that_was_drawn():
    data = sources()
    pairs = TrainingPairs(data, sampler_of(data), KltInliers(), None, 20)
    for i in range(20):
        at, choice = pairs.sampler.draw(0, i)
        pair, sequence = pairs[i].pair, data[at].sequences[choice.sequence]
        assert (pair.index0, pair.index1, pair.name) == (choice.index0, choice.index1, pairs.name(i))
        np.testing.assert_array_equal(pair.image0, sequence.frame(choice.index0))
        np.testing.assert_array_equal(pair.image1, sequence.frame(choice.index1))


@pytest.mark.parametrize(("uses_frames", "uses_depth"), [(False, False), (True, False), (False, True), (True, True)])
def test_pairs_may_be_turned_where_labels_need_their_homography_alone(uses_frames, uses_depth):
    asked = []

    def note(pair, generator, planar):
        asked.append(planar)
        return pair

    check = SimpleNamespace(uses_frames=uses_frames, uses_depth=uses_depth)
    data = [Source([flight(5)], inliers=check)]
    TrainingPairs(data, sampler_of(data), KltInliers(), note, 1)[0]
    assert asked == [not uses_frames and not uses_depth]


def test_each_pair_is_augmented_in_its_own_way_by_the_seed():
    drawn = []

    def note(pair, generator, planar):
        drawn.append(generator.random())
        return pair

    data = sources()
    for seed in (3, 4):
        pairs = TrainingPairs(data, sampler_of(data, seed), KltInliers(), note, 3)
        for i in range(3):
            pairs[i]
    assert len(set(drawn)) == 6


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


def test_a_pair_whose_files_the_system_refuses_passes_as_its_error():
    class Refused:
        def __getitem__(self, index):
            raise OSError(5, "Input/output error", "/data/7.png")

        def name(self, index):
            return "walk:3-9"

    with pytest.raises(BadInputError, match=r"walk:3-9 can't be read: /data/7\.png: Input/output error"):
        unpack(PackedPairs(Refused())[0])
