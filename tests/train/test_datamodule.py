import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight, texture
from train_data import DATA, module, ready

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import unpack
from sips_lit.train.loader import LabelledPair


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


@pytest.mark.parametrize(
    ("option", "words"), [({"between": -1}, r"between .* is -1"), ({"budgets": [25, 0]}, r"budgets .* are \[25, 0\]")]
)
def test_numbers_that_can_label_nothing(tmp_path, option, words):
    with pytest.raises(BadInputError, match=words):
        module(tmp_path, **option)


def test_frames_that_do_not_overlap(tmp_path):
    sequence = ArraySequence([texture(80, 96, seed) for seed in range(10)], "cuts")
    with pytest.raises(BadInputError, match=r"no two frames of cuts_0to7 overlap"):
        module(tmp_path, [sequence]).prepare_data()


@pytest.mark.parametrize("steps", [-1, 0])
def test_training_is_counted_in_steps(tmp_path, steps):
    with pytest.raises(BadInputError, match=r"trainer\.max_steps"):
        ready(module(tmp_path), max_steps=steps).train_dataloader()
    data = module(tmp_path)
    data.setup("fit")
    with pytest.raises(BadInputError, match=r"trainer\.max_steps"):
        data.train_dataloader()  # not attached to a trainer


@pytest.mark.parametrize(("accumulate", "ranks"), [(1, 1), (3, 1), (1, 2), (2, 2)])
def test_a_step_takes_a_pair_of_each_process_and_accumulation(tmp_path, accumulate, ranks):
    names = []
    for rank in range(ranks):
        loader = ready(module(tmp_path), accumulate=accumulate, rank=rank, ranks=ranks).train_dataloader()
        assert len(loader) == 6 * accumulate
        names.append([pair.name for pair in loader])
    single = ready(module(tmp_path), max_steps=6 * accumulate * ranks).train_dataloader()
    expected = [pair.name for pair in single]
    for rank in range(ranks):
        assert names[rank] == expected[rank::ranks]


def test_pairs_are_the_same_for_any_number_of_workers(tmp_path):
    def stream(loading, labelling):
        data = module(
            tmp_path, loading_workers=loading, labelling_workers=labelling, augmentation=Augmentation(), seed=4
        )
        return [(pair.name, pair.image0) for pair in ready(data, max_steps=9).train_dataloader()]

    plain = stream(0, 1)
    assert len({name for name, _ in plain}) > 3
    for loading, labelling in ((1, 1), (2, 3)):
        other = stream(loading, labelling)
        assert [name for name, _ in other] == [name for name, _ in plain]
        assert all(torch.equal(a, b) for (_, a), (_, b) in zip(plain, other, strict=True))


def test_the_seed_chooses_the_pairs(tmp_path):
    def names(seed):
        return [pair.name for pair in ready(module(tmp_path, seed=seed), max_steps=9).train_dataloader()]

    assert names(0) == names(0) != names(1)


def test_training_never_sees_validation_frames(tmp_path):
    data = ready(module(tmp_path), max_steps=40)
    trained = {pair.name.split(":")[0] for pair in data.train_dataloader()}
    validated = {unpack(packed).pair.name.split(":")[0] for packed in data.val_dataloader()}
    assert trained == {"a_0to10", "b_0to8"}
    assert validated <= {"a_10to14", "b_8to12"}


def test_validation_pairs_are_fixed_and_unaugmented(tmp_path):
    def pairs(**options):
        data = ready(module(tmp_path, augmentation=Augmentation(), **options))
        return [unpack(packed).pair for packed in data.val_dataloader()], data.validation_digest()

    (one, digest), (two, same), (_, other) = pairs(), pairs(loading_workers=2), pairs(seed=7)
    assert len(one) == 5
    assert len({pair.name for pair in one}) == 5
    assert digest == same != other
    for a, b in zip(one, two, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.image0, a.frames[0])
        np.testing.assert_array_equal(a.image0, b.image0)


def test_indexes_are_measured_once(tmp_path):
    data = [flight(14, size=(96, 80), name="a")]
    data[0].to_frame = None
    module(tmp_path, data).prepare_data()
    reads = data[0].reads
    assert reads >= 14
    again = module(tmp_path, data)
    again.prepare_data()
    again.setup("fit")
    assert data[0].reads == reads


def test_a_source_may_have_an_inlier_check_of_its_own(tmp_path):
    own = HomographyInliers()
    data = module(tmp_path, [Source([DATA[0]], name="plane", inliers=own), Source([DATA[1]], name="film")])
    assert [source.name for source in data.sources] == ["plane", "film"]
    assert data.check_of(data.sources[0]) is own
    assert data.check_of(data.sources[1]) is data.inliers
    loader = ready(data).train_dataloader()
    assert loader.checks == [own, data.inliers]


def test_mixed_sizes_of_sequences(tmp_path):
    small = flight(10, size=(70, 58), seed=5, name="small")
    loaded = list(ready(module(tmp_path, [DATA[0], small]), max_steps=12).train_dataloader())
    assert {tuple(pair.image0.shape) for pair in loaded} == {(1, 1, 80, 96), (1, 1, 58, 70)}


def test_only_images_of_labelled_pairs_go_to_the_device(tmp_path):
    data = ready(module(tmp_path))
    pair = next(iter(data.train_dataloader()))
    moved = data.transfer_batch_to_device(pair, torch.device("meta"), 0)
    assert isinstance(moved, LabelledPair)
    assert moved.image0.is_meta
    packed = {"pixels": torch.from_numpy(texture(4, 4))}
    assert data.transfer_batch_to_device(packed, torch.device("meta"), 0) is packed


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
