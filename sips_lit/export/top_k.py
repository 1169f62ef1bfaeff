"""Image to points as one module, for exported graphs: the network, suppression, sub-pixel fit, and the budget."""

from __future__ import annotations

import copy
from typing import Final

import torch
from torch import Tensor, nn

from sips_lit.detect.budget import Budget
from sips_lit.detect.covariance import covariance_matrices
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.export.inlier_count import points_to_keep, recalibrated
from sips_lit.export.logits import LogitsOfImage
from sips_lit.export.peak_steps import best_pixels, fitted_offsets, peak_pixels


class TopPoints(nn.Module):
    """The points that a detector of ``network`` and ``selector`` finds `within` a ``budget``, of a batch of images.

    Of images (B, 1, H, W), grey, 0 to 255: ``keypoints`` (B, N, 2) float32 as (x, y), ``scores`` (B, N) float32, best first,
    and ``count`` (B,) int64, how many of the N are points; the others have (-1, -1) and 0. N is `Budget.candidates`. With k
    also ``enough`` (B,) bool, whether they hold k inliers with the probability that the budget asks for.

    Raises BadInputError for a network of several scales, and for a budget of no points.
    """

    description: Final = (
        "Succinct interest points: input `image` (B, 1, H, W), grey, 0 to 255; outputs `keypoints` (B, N, 2) float32, "
        "(x, y) with (0, 0) at the centre of the top-left pixel, `scores` (B, N) float32, the probabilities of being "
        "inliers, best first, and `count` (B,) int64, how many of the N rows are points: the others have (-1, -1) and 0. "
        "`enough` (B,), where there is one, says whether they hold k inliers as surely as the budget asks; `covariance` "
        "(B, N, 2, 2), where there is one, how surely a point is where it is, in pixels squared. Metadata "
        "`sips_lit`: network, selector, recalibration; `sips_lit_budget`: how many points are kept."
    )

    def __init__(self, network: ScoreNetwork, selector: PointSelector, budget: Budget) -> None:
        super().__init__()
        if network.scales > 1:
            raise BadInputError(
                f"the network detects on {network.scales} scales, whose points can't be put together in an exported model: "
                "give scales=1, or export the map (points=false) and run it on each level of a pyramid"
            )
        if budget.candidates < 1:
            raise BadInputError("n is 0: an exported model needs at least one point")
        self.network = copy.deepcopy(network).cpu().requires_grad_(False)
        self.selector, self.budget, self.logits = selector, budget, LogitsOfImage(self.network)
        self.eval()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names, in the order of what a call returns."""
        enough = () if self.budget.k is None else ("enough",)
        covariance = () if self.network.covariance_head is None else ("covariance",)
        return ("keypoints", "scores", "count", *enough, *covariance)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Points of images (B, 1, H, W) of any number type."""
        numbers = None
        if self.network.covariance_head is None:
            logits = self.logits(image.float())[:, 0]
        else:
            logits, numbers = self.network.logits_and_covariance_numbers(image.float())
            logits = logits[:, 0]
        pixels = peak_pixels(logits, self.selector.nms_radius)
        best, rows, columns = best_pixels(logits, pixels, self.budget.candidates, self.selector.border)
        xy = torch.stack([columns, rows], -1).to(logits.dtype)
        if self.selector.subpixel:
            xy = xy + fitted_offsets(logits, rows, columns)
        recalibration = self.selector.recalibration
        found = (best > -torch.inf).sum(1)
        count, enough = points_to_keep(best, found, self.budget, recalibration)
        kept = torch.arange(best.shape[1], device=best.device) < count[:, None]
        score = torch.sigmoid(recalibrated(best, recalibration, count[:, None]))
        outputs = [torch.where(kept[..., None], xy, -1.0), torch.where(kept, score, 0.0), count]
        if enough is not None:
            outputs.append(enough)
        if numbers is not None:
            pixels = (rows * logits.shape[-1] + columns)[:, None].expand(-1, numbers.shape[1], -1)
            covariance = covariance_matrices(numbers.flatten(2).gather(2, pixels).transpose(1, 2))
            outputs.append(torch.where(kept[..., None, None], covariance, 0.0))
        return tuple(outputs)
