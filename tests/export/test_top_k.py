import numpy as np
import pytest
import torch
from exported_models import BUDGETS, SIZES, model_of, textured
from tiny_network import tiny_network

from sips_lit.detect.budget import Budget
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.export.top_k import TopPoints


def expected_of(model: TopPoints, image: np.ndarray):
    return SipsDetector(model.network, model.selector).within(image, model.budget)


@pytest.mark.parametrize("name", BUDGETS)
@pytest.mark.parametrize("size", SIZES)
def test_points_are_those_of_the_detector(name, size):
    model, image = model_of(name), textured(size)
    outputs = dict(zip(model.outputs, model(torch.from_numpy(image)[None, None]), strict=True))
    xy, score, count = (outputs.pop(name)[0].numpy() for name in ("keypoints", "scores", "count"))
    points, reached = expected_of(model, image)
    rows = BUDGETS[name].candidates
    assert (xy.shape, score.shape, int(count)) == ((rows, 2), (rows,), len(points))
    np.testing.assert_allclose(xy[: len(points)], points.xy, atol=1e-4)
    np.testing.assert_allclose(score[: len(points)], points.score, atol=1e-6)
    assert set(xy[len(points) :].ravel()) <= {-1}
    assert not score[len(points) :].any()
    assert list(outputs) == {"best": [], "enough": ["enough", "covariance"]}[name]
    if name == "enough":
        assert bool(outputs["enough"]) == reached
        covariance = outputs["covariance"][0].numpy()
        np.testing.assert_allclose(covariance[: len(points)], points.covariance, rtol=1e-4, atol=1e-5)
        assert not covariance[len(points) :].any()


def test_a_batch_is_its_images():
    model, images = (
        model_of("best"),
        np.stack([textured((60, 77), seed) for seed in (1, 2)] + [np.full((60, 77), 90, np.uint8)]),
    )
    together = model(torch.from_numpy(images)[:, None])
    for index, image in enumerate(images):
        for many, one in zip(together, model(torch.from_numpy(image)[None, None]), strict=True):
            torch.testing.assert_close(many[index : index + 1], one)
    assert len(set(together[2].tolist())) > 1


def test_a_blank_image_has_few_points():
    assert int(model_of("best")(torch.full((1, 1, 60, 80), 90.0))[2]) <= 1


def test_of_equal_points_the_first_in_reading_order_come_first():
    tile = textured((24, 24))
    tile[:4], tile[-4:], tile[:, :4], tile[:, -4:] = 90, 90, 90, 90
    image = np.full((76, 100), 90, np.uint8)
    for top, left in ((2, 2), (2, 40), (26, 70), (48, 10)):
        image[top : top + 24, left : left + 24] = tile
    network = tiny_network(derivatives=True)  # of one octave: the mean of several rounds equal points apart
    model = TopPoints(network, model_of("best").selector, BUDGETS["best"])
    xy, score, count = (output[0].numpy() for output in model(torch.from_numpy(image)[None, None]))
    points, _ = expected_of(model, image)
    np.testing.assert_allclose(xy[: int(count)], points.xy, atol=1e-4)
    assert len(set(score[: int(count)])) < int(count), "there are ties"


def test_networks_of_several_scales_are_refused():
    with pytest.raises(BadInputError, match=r"3 scales, .*: give scales=1, or export the map"):
        TopPoints(tiny_network(scales=3), PointSelector(), Budget())


def test_no_points_are_refused():
    with pytest.raises(BadInputError, match="n is 0: an exported model needs at least one point"):
        TopPoints(tiny_network(), PointSelector(), Budget(0))
