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


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"between": -1}, r"between .* is -1"),
        ({"budgets": [25, 0]}, r"budgets .* are \[25, 0\]"),
        ({"val_pairs": 0}, "val_pairs of the data is 0: give 1 or more"),
        ({"loading_workers": -1}, "loading_workers of the data is -1: give 0 or more"),
        ({"labelling_workers": -1}, "labelling_workers of the data is -1: give 0 or more"),
        ({"seed": -1}, "^seed of the data is -1: give 0 or more"),
        ({"val_seed": -1}, "val_seed of the data is -1: give 0 or more"),
    ],
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
