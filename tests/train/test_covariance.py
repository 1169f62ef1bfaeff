from functools import partial

import numpy as np
import pytest
import torch
from textured_scenes import texture
from tiny_network import tiny_network
from train_run import Watch, fit, make_data, make_module

from sips_lit.callbacks.covariance import CovarianceValidation
from sips_lit.detect.covariance import covariances_at
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, SelectedPoints, image_tensor
from sips_lit.errors import BadInputError
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.point_labels import PointLabels
from sips_lit.matching.mutual_nearest import FOREVER, MutualLifetimes
from sips_lit.train.covariance import CovarianceModule
from sips_lit.train.loader import LabelledPair
from sips_lit.types import Keypoints, Reason


def make_covariance_module(network: ScoreNetwork | None = None) -> CovarianceModule:
    network = network or tiny_network(covariance=True)
    return CovarianceModule(network, PointSelector(3), partial(torch.optim.Adam, lr=1e-2), points=40)


def side(rows, columns, residual) -> tuple[SelectedPoints, PointLabels]:
    rows, columns, ones = np.array(rows), np.array(columns), np.ones(len(rows), np.float32)
    xy = np.stack([columns, rows], 1).astype(np.float32)
    points = SelectedPoints(Keypoints(xy, ones, ones), np.zeros(len(rows), np.int64), rows, columns)
    values = None if residual is None else np.array(residual, np.float32)
    inlier = ones > 0 if values is None else np.isfinite(values[:, 0])
    reason = np.where(inlier, Reason.INLIER, Reason.FAR).astype(np.uint8)
    return points, PointLabels(inlier, np.ones(len(rows), bool), reason, inlier.astype(np.float32), values)


def labelled(side0, side1, matches, last) -> LabelledPair:
    """Image 1 is twice as high as image 0, and as wide."""
    images = image_tensor(texture(40, 50)), image_tensor(texture(80, 50, 1))
    index0, index1 = np.array(matches, np.int64).reshape(-1, 2).T
    inliers = MutualLifetimes(index0, index1, np.maximum(index0, index1) + 1, np.array(last))
    return LabelledPair(*images, side0[0], side1[0], side0[1], side1[1], inliers, 0, "hand")


def step(module: CovarianceModule, pair: LabelledPair) -> tuple[torch.Tensor, dict[str, float]]:
    logged: dict[str, float] = {}
    module.log = lambda name, value, **_: logged.update({name: float(value)})
    return module.training_step(pair, 0), logged


def test_the_loss_is_its_plain_definition():
    """Two matches of all points; the third is one of a smaller budget, which labels say nothing of."""
    module, nan = make_covariance_module(), [np.nan, np.nan]
    torch.nn.init.normal_(module.network.covariance_head.weight, std=0.1)
    side0 = side([3, 20, 30], [4, 30, 10], [[0.5, -1.0], nan, [2.0, 0.25]])
    side1 = side([10, 70, 9], [43, 5, 20], [[-0.5, 1.5], [1.0, 0.0], nan])
    pair = labelled(side0, side1, [(0, 1), (2, 0), (1, 2)], [FOREVER, FOREVER, 2])
    loss, logged = step(module, pair)
    covariance = [
        covariances_at(module.network, image, points).detach().double()
        for image, points in ((pair.image0, pair.points0), (pair.image1, pair.points1))
    ]
    zoom, total = torch.diag(torch.tensor([1.0, 2.0])).double(), 0.0
    for i, j in ((0, 1), (2, 0)):
        forward = zoom @ covariance[0][i] @ zoom + covariance[1][j]
        backward = covariance[0][i] + zoom.inverse() @ covariance[1][j] @ zoom.inverse()
        for residual, claimed in ((side0[1].residual[i], forward), (side1[1].residual[j], backward)):
            normal = torch.distributions.MultivariateNormal(torch.zeros(2).double(), claimed)
            total += -float(normal.log_prob(torch.from_numpy(residual).double())) - np.log(2 * np.pi)
    assert float(loss) == pytest.approx(total / 4, rel=1e-4)
    assert logged["train/residuals"] == 2


@pytest.mark.parametrize("residual", [None, [[np.nan, np.nan]]])
def test_a_pair_without_residuals_teaches_nothing(residual):
    module = make_covariance_module()
    loss, logged = step(module, labelled(side([3], [4], residual), side([10], [43], residual), [], []))
    loss.backward()
    assert float(loss) == logged["train/residuals"] == 0
    assert not module.network.covariance_head.bias.grad.any()


def test_a_run_learns_the_head_and_leaves_the_scores(tmp_path):
    network = tiny_network(covariance=True)
    before = {name: weight.clone() for name, weight in network.state_dict().items()}
    watch, validation = Watch(), CovarianceValidation()
    fit(make_covariance_module(network), make_data(tmp_path), 8, [watch, validation])
    changed = {name for name, weight in network.state_dict().items() if not torch.equal(weight, before[name])}
    assert changed == {"covariance_head.weight", "covariance_head.bias"}
    assert watch.metrics["train/residuals"] > 0
    assert all(pair.features0.keypoints.covariance is not None for pair in watch.validated)
    expected = [pair.residuals(40) for pair in watch.validated]
    assert validation.metric.result().residuals == sum(len(residual) for residual, _ in expected) > 0


def test_a_check_without_residuals_is_no_validation_of_covariances(tmp_path):
    data = make_data(tmp_path)
    data.inliers = HomographyInliers()
    validation = CovarianceValidation()
    fit(make_covariance_module(), data, 1, [validation])
    assert validation.metric.result().residuals == 0


def test_each_module_has_its_network():
    with pytest.raises(BadInputError, match="experiment=covariance"):
        make_covariance_module(tiny_network())
    with pytest.raises(BadInputError, match="experiment=covariance"):
        make_module(network=tiny_network(covariance=True))
