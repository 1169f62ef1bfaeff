import numpy as np
import pytest
from textured_scenes import ArraySequence, flight
from train_data import DATA, module, ready

from sips_lit.errors import BadInputError
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import unpack


def test_the_end_of_every_sequence_validates(tmp_path):
    data = module(tmp_path)
    assert [s.name for s in data.sources[0].sequences] == ["a_0to10", "b_0to8"]
    assert [s.name for s in data.val_sources[0].sequences] == ["a_10to14", "b_8to12"]


def test_validation_data_of_its_own_leaves_training_whole(tmp_path):
    own = [flight(5, seed=9, name="own")]
    data = module(tmp_path, val_data=own)
    assert list(data.sources[0].sequences) == DATA
    assert list(data.val_sources[0].sequences) == own


@pytest.mark.parametrize("frames", [2, 3])
def test_sequences_too_short_to_split(tmp_path, frames):
    with pytest.raises(BadInputError, match=r"too short to keep 15% of each .* \(data@val_data"):
        module(tmp_path, [flight(frames)], val_fraction=0.15)


def test_no_data_at_all(tmp_path):
    with pytest.raises(BadInputError, match="no sequence"):
        module(tmp_path, [])


def test_validation_pairs_are_fixed_and_unaugmented(tmp_path):
    def pairs(**options):
        data = ready(module(tmp_path, augmentation=Augmentation(), **options))
        return [unpack(packed).pair for packed in data.val_dataloader()], data.validation_pairs()

    (one, told), (two, same), (_, other) = pairs(), pairs(loading_workers=2, seed=7), pairs(val_seed=7)
    assert len(one) == 5
    assert len({pair.name for pair in one}) == 5
    assert told == [f"{pair.name} 96x80" for pair in one]
    assert told == same != other  # runs that differ in their seed are judged on the same pairs
    for a, b in zip(one, two, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.image0, a.frames[0])
        np.testing.assert_array_equal(a.image0, b.image0)


@pytest.mark.parametrize("trained_on", [{"overlap": 0.8}, {"overlap": 0.95}, {"spread": 1.0}])
def test_validation_pairs_hang_on_nothing_that_is_trained_on(tmp_path, trained_on):
    usual, other = ready(module(tmp_path)), ready(module(tmp_path, **trained_on))
    assert other.validation_pairs() == usual.validation_pairs()
    drawn = [[sampler.draw(0, index) for index in range(40)] for sampler in (usual.sampler, other.sampler)]
    assert drawn[0] != drawn[1]


def test_least_overlap_of_validation_pairs(tmp_path):
    data = ready(module(tmp_path, val_overlap=0.95, val_pairs=10))
    index = data._val_sampler().indexes
    wide = ready(module(tmp_path, val_overlap=0.2, val_pairs=12))
    assert len(data.val_choices) < len(wide.val_choices)
    for _, choice in data.val_choices:
        first, second = sorted((choice.index0, choice.index1))
        assert index[choice.sequence].read().overlap(first)[second - first - 1] >= 0.95


@pytest.mark.parametrize("key", ["overlap", "val_overlap"])
def test_without_a_pair_the_key_is_named(tmp_path, key):
    with pytest.raises(BadInputError, match=rf"ask for less overlap \(datamodule\.{key}\)"):
        module(tmp_path, **{key: 1.5}).prepare_data()


@pytest.mark.parametrize("ranks", [1, 2, 3, 4, 7])
def test_each_validation_pair_counts_in_one_process_and_all_take_equally_many(tmp_path, ranks):
    shares, counted = [], []
    for rank in range(ranks):
        data = ready(module(tmp_path), rank=rank, ranks=ranks)
        names = [unpack(packed).pair.name for packed in data.val_dataloader()]
        shares.append(len(names))
        counted += [name for at, name in enumerate(names) if not data.repeated(at)]
    alone = [unpack(packed).pair.name for packed in ready(module(tmp_path)).val_dataloader()]
    assert sorted(counted) == sorted(alone)
    assert len(set(shares)) == 1


def test_a_copy_of_the_frames_has_their_sample_and_other_frames_have_not(tmp_path):
    sample = module(tmp_path).sample_digest()
    copies = [ArraySequence(list(sequence.frames), sequence.name) for sequence in DATA]
    for copy in copies:
        copy.fingerprint = "other file times"
    assert module(tmp_path, copies).data_digest() != module(tmp_path).data_digest()
    assert module(tmp_path, copies).sample_digest() == sample
    for sequence, frame in ((0, 0), (0, 13), (1, 5), (1, 11)):  # in training and in validation
        changed = [ArraySequence([*sequence.frames], sequence.name) for sequence in DATA]
        changed[sequence].frames[frame] = changed[sequence].frames[frame] ^ 1
        assert module(tmp_path, changed).sample_digest() != sample
    renamed = [ArraySequence(list(DATA[0].frames), "c"), DATA[1]]
    shorter = [DATA[0], ArraySequence(list(DATA[1].frames[:-1]), DATA[1].name)]
    assert len({module(tmp_path, data).sample_digest() for data in (renamed, shorter, DATA)}) == 3
