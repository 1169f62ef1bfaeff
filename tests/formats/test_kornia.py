import numpy as np
import pytest
import torch
from textured_scenes import keypoints, texture
from tiny_network import tiny_detector

from sips_lit.describe.sift import RootSift
from sips_lit.detect.recalibration import Recalibration
from sips_lit.errors import BadInputError
from sips_lit.formats.kornia import RADIUS, SipsFeature, kornia_lafs
from sips_lit.types import Keypoints

POINTS = keypoints([[10.25, 20.5], [30, 7]], None, 2.0)
IMAGES = [texture(90, 120, seed) for seed in range(2)]
BATCH = torch.stack([torch.from_numpy(image)[None] for image in IMAGES]) / 255


@pytest.fixture(scope="module")
def kornia():
    return pytest.importorskip("kornia.feature", reason="kornia is what the frames are for: pip install kornia")


def test_frames_are_those_of_kornia(kornia):
    lafs = kornia_lafs(POINTS, 5)
    scale = torch.from_numpy(POINTS.scale)[None, :, None, None] * 5
    expected = kornia.laf_from_center_scale_ori(torch.from_numpy(POINTS.xy)[None], scale)
    torch.testing.assert_close(lafs, expected)
    np.testing.assert_array_equal(kornia.get_laf_center(lafs)[0], POINTS.xy)
    np.testing.assert_allclose(kornia.get_laf_scale(lafs).flatten(), 10)
    np.testing.assert_allclose(kornia.get_laf_orientation(lafs).flatten(), 0)
    assert kornia_lafs(Keypoints.empty()).shape == (1, 0, 2, 3)


def test_kornia_looks_where_the_point_is(kornia):
    image = torch.zeros(1, 1, 40, 50)
    image[0, 0, 12, 31] = 1
    patch = kornia.extract_patches_simple(
        image, kornia_lafs(keypoints([[31, 12]]), 4), 9, normalize_lafs_before_extraction=True
    )
    flat = patch.flatten()
    assert int(flat.argmax()) == flat.numel() // 2
    np.testing.assert_allclose(patch[0, 0, 0].numpy(), patch[0, 0, 0].numpy()[::-1, ::-1], atol=1e-5)


def test_a_batch_is_its_images():
    detector = tiny_detector()
    feature = SipsFeature(detector, n=30)
    lafs, responses, descriptors = feature(BATCH)
    assert lafs.shape == (2, 30, 2, 3)
    for index, image in enumerate(IMAGES):
        points = detector(image, 30)
        torch.testing.assert_close(lafs[index], kornia_lafs(points)[0])
        np.testing.assert_array_equal(responses[index], points.score)
        np.testing.assert_array_equal(descriptors[index], RootSift().describe(image, points))
    colour = feature(BATCH.expand(-1, 3, -1, -1))
    assert all(torch.equal(a, b) for a, b in zip(colour, (lafs, responses, descriptors), strict=True))


def test_channels_in_the_order_of_opencv():
    colour = torch.stack([torch.from_numpy(texture(90, 120, seed)) for seed in (3, 4, 5)])[None]
    expected = SipsFeature(tiny_detector(), n=30)(colour)
    found = SipsFeature(tiny_detector(), n=30, color="bgr")(colour.flip(1))
    assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))
    assert not torch.equal(SipsFeature(tiny_detector(), n=30)(colour.flip(1))[0], expected[0])


def test_missing_points_are_zeros(kornia):
    batch = torch.stack([BATCH[0], torch.zeros_like(BATCH[0])])
    lafs, responses, descriptors = SipsFeature(tiny_detector(), n=30)(batch)
    filled = kornia.laf_is_filled(lafs)
    assert filled.sum(1).tolist() == [30, 1]
    assert not responses[~filled].any()
    assert not descriptors[~filled].any()


def test_a_mask_leaves_points_out():
    mask = torch.zeros(2, 1, 90, 120)
    mask[:, :, :, 60:] = 0.5
    every = tiny_detector()(IMAGES[0], 10**6)
    lafs, responses, _ = SipsFeature(tiny_detector(), n=10)(BATCH, mask)
    kept = every[np.rint(every.xy[:, 0]) >= 60].best(10)
    np.testing.assert_array_equal(lafs[0, :, :, 2], kept.xy)
    np.testing.assert_array_equal(responses[0], kept.score / 2)
    assert not SipsFeature(tiny_detector())(BATCH, torch.zeros(2, 1, 90, 120))[1].numel()


def test_responses_are_those_of_the_points_that_a_mask_leaves():
    detector = tiny_detector(recalibration=Recalibration(0.5, -1.0, 0.8))
    whole = SipsFeature(detector, n=10)(BATCH)
    for same, other in zip(whole, SipsFeature(detector, n=10)(BATCH, torch.ones(2, 1, 90, 120)), strict=True):
        torch.testing.assert_close(same, other)


def test_no_images():
    assert [tuple(part.shape) for part in SipsFeature(tiny_detector())(BATCH[:0])] == [
        (0, 0, 2, 3),
        (0, 0),
        (0, 0, 128),
    ]


def test_other_shapes_are_refused():
    feature = SipsFeature(tiny_detector())
    with pytest.raises(BadInputError, match=r"must be \(B, 1, H, W\)"):
        feature(BATCH[0])
    with pytest.raises(BadInputError, match="mask must be of shape"):
        feature(BATCH, torch.ones(2, 1, 9, 9))
    with pytest.raises(BadInputError, match="from nan"):
        feature(BATCH * torch.nan)


def test_kornias_matcher_takes_it(kornia):
    matcher = kornia.LocalFeatureMatcher(SipsFeature(tiny_detector(), n=60), kornia.DescriptorMatcher("mnn", 0.9))
    moved = torch.from_numpy(np.roll(IMAGES[0], 4, 1))[None, None] / 255
    found = matcher({"image0": BATCH[:1], "image1": moved})
    shift = (found["keypoints1"] - found["keypoints0"]).numpy()
    assert (np.abs(shift - [4, 0]).max(1) < 0.1).mean() > 0.5


def test_the_network_is_a_part_of_it():
    feature = SipsFeature(tiny_detector())
    assert {name.partition(".")[0] for name in feature.state_dict()} == {"network"}
    assert 3 * RootSift().size == RADIUS  # the support is 6 sizes wide
