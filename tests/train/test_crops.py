from itertools import pairwise

import numpy as np
import pytest
import torch
from textured_scenes import Damaged, flight, texture
from tiny_network import tiny_network

from sips_lit.detect.selection import image_tensor
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.source import Source
from sips_lit.train.augment import Augmentation
from sips_lit.train.crops import CropBatch, CropStream, TrainingCrops, cut
from sips_lit.train.dataset import SkippedItems

SOURCES = [
    Source([flight(5, size=(80, 64), name="a"), flight(3, size=(72, 60), seed=1, name="b")], 3.0),
    Source([flight(4, size=(50, 90), seed=2, name="c")], 1.0, name="other"),
]


def crops(sources=SOURCES, augmentation=None, length: int = 6, seed: int = 0, **options) -> TrainingCrops:
    return TrainingCrops(sources, augmentation, length, seed, **{"count": 4, "size": 24, "margin": 5, **options})


def stream(items: TrainingCrops, workers: int = 0, **options) -> CropStream:
    return CropStream(items, workers, 60, SkippedItems("frame"), **options)


def assert_same(a: list[CropBatch], b: list[CropBatch]) -> None:
    assert [batch.names for batch in a] == [batch.names for batch in b]
    for one, other in zip(a, b, strict=True):
        assert torch.equal(one.images, other.images)
        assert torch.equal(one.inside, other.inside)


def find(frame: np.ndarray, crop: np.ndarray) -> tuple[int, int]:
    """Where the crop is in the frame, by looking everywhere."""
    windows = np.lib.stride_tricks.sliding_window_view(frame, crop.shape)
    ((row, column),) = np.argwhere((windows == crop).all((2, 3)))
    return int(row), int(column)


def test_crops_are_of_the_frames_that_are_named():
    frames = {f"{s.name}:{i}": s.frames[i] for source in SOURCES for s in source.sequences for i in range(len(s))}
    batch = crops()[2]
    assert batch.images.shape == (4, 1, 34, 34)
    assert batch.images.dtype == torch.uint8
    assert batch.inside.shape == (4, 1, 24, 24)
    assert batch.inside.all()
    for image, name in zip(batch.images, batch.names, strict=True):
        padded = np.pad(frames[name], 5, mode="edge")
        row, column = find(padded, image[0].numpy())
        assert 0 <= row <= frames[name].shape[0] - 24
        assert 0 <= column <= frames[name].shape[1] - 24


@pytest.mark.parametrize(("top", "left"), [(0, 0), (13, 20), (40, 56), (2, 55)])
def test_a_network_sees_in_a_crop_what_it_sees_in_the_frame(top, left):
    """Also where the frame ends: no border is there that is not in the frame."""
    frame, network, margin = texture(64, 80), tiny_network(derivatives=True), 6
    assert network.radius < margin
    crop, inside = cut(frame, top, left, 24, margin, lambda image: image)
    assert inside.all()
    with torch.no_grad():
        logits = network.interior(image_tensor(crop), margin)[0, 0]
        expected = network(image_tensor(frame))[0, 0, top : top + 24, left : left + 24]
    torch.testing.assert_close(logits, expected)


def test_the_border_is_replicated_after_the_light_has_changed():
    noise = np.random.default_rng(0).integers(0, 255, (64, 80)).astype(np.uint8)
    crop, _ = cut(texture(64, 80), 0, 0, 24, 6, lambda image: noise[: image.shape[0], : image.shape[1]])
    np.testing.assert_array_equal(crop, np.pad(noise[:30, :30], ((6, 0), (6, 0)), mode="edge"))


@pytest.mark.parametrize("shape", [(10, 80), (64, 9), (1, 1)])
def test_frames_smaller_than_a_crop_say_what_is_theirs(shape):
    frame = texture(*shape)
    crop, inside = cut(frame, 0, 0, 24, 6, lambda image: image)
    assert crop.shape == (36, 36)
    height, width = min(shape[0], 24), min(shape[1], 24)
    assert inside.sum() == height * width
    np.testing.assert_array_equal(crop[6:30, 6:30][inside].reshape(height, width), frame[:height, :width])


def test_frames_are_drawn_by_the_weights_of_sources_and_then_alike():
    drawn = [crops().draw(number) for number in range(4000)]
    places, counts = np.unique(drawn, axis=0, return_counts=True)
    assert len(places) == 5 + 3 + 4
    for (source, *_), count in zip(places, counts, strict=True):
        expected = 4000 * (0.75 / 8 if source == 0 else 0.25 / 4)
        assert abs(count - expected) < 5 * expected**0.5


def test_every_crop_of_a_run_is_another_one():
    batches = list(stream(crops(length=8)))
    images = [image for batch in batches for image in batch.images]
    assert len({image.numpy().tobytes() for image in images}) == 32
    assert all(a.names != b.names for a, b in pairwise(batches))


def test_the_seed_and_nothing_else_chooses_the_crops():
    strong = Augmentation(transpose=0.5, invert=0.3, log2_shrink=0.4, rotation=0.3)
    expected = list(stream(crops(augmentation=strong)))
    for workers in (0, 2):
        assert_same(list(stream(crops(augmentation=strong), workers)), expected)
    other = list(stream(crops(augmentation=strong, seed=1)))
    assert not torch.equal(other[0].images, expected[0].images)
    plain = list(stream(crops()))
    assert [batch.names for batch in plain] == [batch.names for batch in expected]
    assert not torch.equal(plain[0].images, expected[0].images)


@pytest.mark.parametrize("stop", [1, 4])
def test_a_resumed_stream_goes_on_as_if_never_interrupted(stop):
    expected = list(stream(crops()))
    first = stream(crops())
    for batch, _ in zip(first, range(stop), strict=False):
        assert isinstance(batch, CropBatch)
    state = first.state_dict()
    assert state["position"] == stop + 1  # zip has taken one more
    second = stream(crops())
    second.load_state_dict(state)
    assert len(second) == len(expected)
    assert_same(list(second), expected[stop + 1 :])


def test_processes_share_the_batches():
    expected = list(stream(crops()))
    shares = [list(stream(crops(), first=rank, stride=2)) for rank in (0, 1)]
    for rank in (0, 1):
        assert_same(shares[rank], expected[rank::2])
    alone = stream(crops())
    alone.load_state_dict({"position": 1, "processes": [SkippedItems().state_dict()] * 2})
    assert_same(list(alone), expected[2:])


class Broken(Damaged):
    bad = (1, 3)


def test_another_frame_takes_the_place_of_one_that_can_not_be_read():
    sources = [Source([Broken(flight(6, size=(80, 64)).frames, "clip")])]
    batches = stream(crops(sources))
    with pytest.warns(InputWarning, match=r"a frame is left out, and others may be: [13]\.png is damaged"):
        taken = list(batches)
    names = {name for batch in taken for name in batch.names}
    assert names <= {"clip:0", "clip:2", "clip:4", "clip:5"}
    assert batches.skipped.count == sum(len(batch.skipped) for batch in taken) > 0
    resumed = stream(crops(sources))
    resumed.load_state_dict(batches.state_dict())
    assert resumed.skipped.count == batches.skipped.count


class Gone(Damaged):
    def frame(self, index):
        raise FileNotFoundError(2, "No such file or directory", "gone.png")


@pytest.mark.parametrize("workers", [0, 1])
def test_data_without_a_readable_frame_ends_in_a_sentence(workers):
    sources = [Source([Gone(flight(6).frames, "clip")])]
    with pytest.raises(
        BadInputError, match=r"20 frames in a row can't be read; the first: clip:\d can't be read: gone"
    ):
        list(stream(crops(sources), workers))


def test_a_batch_moves_and_is_stored():
    batch = crops()[0]
    assert batch.to(torch.device("meta")).images.is_meta
    assert batch.plain()["names"] == list(batch.names)
    assert torch.equal(batch.plain()["images"], batch.images)
