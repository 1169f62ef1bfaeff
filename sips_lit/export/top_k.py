"""Image to points as one module, for exported graphs: the network, suppression, sub-pixel fit, and the budget."""

from __future__ import annotations

import copy
from typing import Final

import torch
from torch import Tensor, nn

from sips_lit.detect.budget import Budget
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.export.inlier_count import points_to_keep, recalibrated
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
        "`enough` (B,), where there is one, says whether they hold k inliers as surely as the budget asks. Metadata "
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
        self.selector, self.budget = selector, budget
        self.eval()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names, in the order of what a call returns."""
        names = ("keypoints", "scores", "count")
        return names if self.budget.k is None else (*names, "enough")

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Points of images (B, 1, H, W) of any number type."""
        logits = self.network(image.float())[:, 0]
        pixels = peak_pixels(logits, self.selector.nms_radius)
        best, rows, columns = best_pixels(logits, pixels, self.budget.candidates)
        xy = torch.stack([columns, rows], -1).to(logits.dtype)
        if self.selector.subpixel:
            xy = xy + fitted_offsets(logits, rows, columns)
        recalibration = self.selector.recalibration
        found = (best > -torch.inf).sum(1)
        count, enough = points_to_keep(best, found, self.budget, recalibration)
        kept = torch.arange(best.shape[1], device=best.device) < count[:, None]
        score = torch.sigmoid(recalibrated(best, recalibration, count[:, None]))
        points = torch.where(kept[..., None], xy, -1.0), torch.where(kept, score, 0.0), count
        return points if enough is None else (*points, enough)
