"""The LightningModule that teaches a trained network how surely its points are where they are; scores stay as they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler

from sips_lit.detect.covariance import covariances_at, with_covariance
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor
from sips_lit.matching.mutual_nearest import FOREVER
from sips_lit.train.covariance_loss import gaussian_nll, residual_covariances
from sips_lit.train.loader import LabelledPair
from sips_lit.train.score_module import ScoreModule
from sips_lit.types import Features, GreyImage


class CovarianceModule(ScoreModule):
    """Trains the covariance head of a network on the residuals of inlier matches, forward and backward; a step is a pair.

    The other weights are frozen. Matches count whose residual the check measures, as KLT does; a pair without any teaches
    nothing. Arguments: see `ScoreModule`. Raises BadInputError for a network without the head.
    """

    learns: ClassVar[Literal["scores", "covariance"]] = "covariance"

    def __init__(
        self,
        network: ScoreNetwork,
        selector: PointSelector,
        optimizer: Callable[..., Optimizer],
        scheduler: Callable[..., LRScheduler] | None = None,
        points: int = 500,
    ) -> None:
        super().__init__(network, selector, optimizer, scheduler, points)
        network.requires_grad_(False)
        for weights in self.trained:
            weights.requires_grad_(True)

    @property
    def trained(self) -> Iterable[Tensor]:
        """Those of the head."""
        assert self.network.covariance_head is not None
        return self.network.covariance_head.parameters()

    def training_step(self, pair: LabelledPair, batch_idx: int) -> Tensor:
        """Mean of the losses of both directions over the inlier matches."""
        covariance0 = covariances_at(self.network, pair.image0, pair.points0)
        covariance1 = covariances_at(self.network, pair.image1, pair.points1)
        loss = (covariance0.sum() + covariance1.sum()) * 0
        residual0, residual1 = pair.labels0.residual, pair.labels1.residual
        count = 0
        if residual0 is not None and residual1 is not None:
            whole = pair.inliers[pair.inliers.last == FOREVER]  # labels are of the matches of all points
            index0, index1 = (torch.from_numpy(index).to(self.device) for index in (whole.index0, whole.index1))
            own0, own1, count = covariance0[index0], covariance1[index1], len(whole)
            zoom = _size(pair.image1) / _size(pair.image0)
            forward = gaussian_nll(_tensor(residual0[whole.index0], own0), residual_covariances(own0, own1, zoom))
            backward = gaussian_nll(_tensor(residual1[whole.index1], own1), residual_covariances(own1, own0, 1 / zoom))
            if count:
                loss = loss + (forward.mean() + backward.mean()) / 2
        self.log("train/loss", loss.detach(), prog_bar=True, batch_size=1)
        self.log("train/residuals", float(count), batch_size=1)
        self.log("data/skipped_pairs", float(pair.skipped), batch_size=1)
        return loss

    def _features(self, image: GreyImage) -> Features:
        points = self.select(image)
        keypoints = with_covariance(self.network, image_tensor(image, self.device), points)
        descriptor = self.data.descriptor
        return Features(keypoints, descriptor.describe(image, keypoints), descriptor.norm)


def _size(image: Tensor) -> Tensor:
    return image.new_tensor([image.shape[-1], image.shape[-2]])


def _tensor(values: np.ndarray[tuple[int, ...], np.dtype[np.float32]], like: Tensor) -> Tensor:
    return torch.from_numpy(values).to(like)
