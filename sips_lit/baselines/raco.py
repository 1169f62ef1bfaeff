"""RaCo: points and their rank (Shenoi et al. 2026), with a file of weights that the user has."""

from __future__ import annotations

from typing import Final

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sips_lit.baselines.learned import best_inside, fill, network_image, read_weights
from sips_lit.detect.base import BaseDetector, ranked
from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage, Keypoints

_WHERE = "raco.pth from the releases of https://github.com/cvg/RaCo (Apache 2.0)"
_MULTIPLE: Final = 32  # pixels: poolings by 2, 4 and 4
_WIDTHS: Final = (16, 32, 64, 128)
_POOLS: Final = (1, 2, 4, 4)
_MIXED, _RANK_WIDTH, _RANK_BLOCKS = 32, 12, 9
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's
_RADIUS: Final = 1  # pixels: maxima in 3 x 3, and the softmax about them
_TEMPERATURE: Final = 0.5
_UNUSED: Final = "covariance_estimator_head."


class RaCo(BaseDetector):
    """RaCo as its authors run it: maxima in 3 x 3, the ``candidates`` best of them moved by the softmax of the nine logits.

    Points are then in the order of the ranker, which is their score; without ``ranker``, in that of the detection, and
    the score is its probability among all pixels. More than ``candidates`` points are never given. The image keeps its
    size, in float32; grey is given as three channels. Covariances are not computed.

    Pixel (0, 0) of the score map is the first pixel's centre: nothing is shifted. (The authors' code adds 0.5 px to what
    it returns, as COLMAP counts.)
    """

    name = "RaCo"

    def __init__(self, weights: str | None = None, ranker: bool = True, candidates: int = 2048) -> None:
        """``weights`` is the published file. Raises BadInputError where it is missing or another."""
        if weights is None:
            raise BadInputError(f"RaCo's weights are in no package: download {_WHERE} and give detector.weights=FILE")
        held = {str(key).removeprefix("model."): value for key, value in read_weights(weights).items()}
        used = {key: value for key, value in held.items() if not key.startswith(_UNUSED)}
        self.network = fill(RaCoNetwork(), used, weights, f"RaCo ({_WHERE})")
        self.ranker, self.candidates = ranker, candidates

    @torch.inference_mode()
    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        logits, ranks = (scores[0, 0] for scores in self.network(network_image(image).expand(-1, 3, -1, -1)))
        y, x = torch.nonzero(logits == _window_max(logits), as_tuple=True)
        best = ranked(torch.stack([x, y], 1).numpy(), logits[y, x].numpy(), self.candidates)
        x, y = x[best], y[best]
        xy = torch.stack([x, y], 1) + softmax_offsets(logits, x, y)
        scores = ranks if self.ranker else logits.flatten().softmax(0).reshape(logits.shape)
        return best_inside(xy, sample_pixels(scores, xy), image.shape, n)[0]


def _window_max(scores: Tensor) -> Tensor:
    return F.max_pool2d(scores[None], 2 * _RADIUS + 1, stride=1, padding=_RADIUS)[0]


def softmax_offsets(logits: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """(N, 2), px: from pixels (x, y) of ``logits`` (H, W) to the mean place of their 3 x 3 pixels, weighted by softmax.

    Beyond the border logits count as 0, as the authors have it.
    """
    steps = torch.arange(-_RADIUS, _RADIUS + 1)
    dy, dx = (step.flatten() for step in torch.meshgrid(steps, steps, indexing="ij"))
    padded = F.pad(logits, [_RADIUS] * 4)
    shares = (padded[y[:, None] + dy + _RADIUS, x[:, None] + dx + _RADIUS] / _TEMPERATURE).softmax(dim=1)
    return shares @ torch.stack([dx, dy], 1).to(shares)


def sample_pixels(scores: Tensor, xy: Tensor) -> Tensor:
    """(N,): the map (H, W), interpolated linearly at ``xy`` (N, 2) px; beyond the outer centres it stays as it is there."""
    grid = (xy + 0.5) / torch.tensor(scores.shape[::-1]) * 2 - 1
    sampled = F.grid_sample(scores[None, None], grid[None, None], padding_mode="border", align_corners=False)
    return sampled[0, 0, 0]


class RaCoNetwork(nn.Module):
    """ALIKED-n16's pyramid with plain convolutions, a head for the score on it, and a ranker on the image itself.

    Submodules are named as in the published file.
    """

    def __init__(self) -> None:
        super().__init__()
        inputs = 3
        for level, width in enumerate(_WIDTHS, 1):
            kernel = 1 if level == 1 else 3
            self.add_module(f"block{level}", _Block(inputs, width, residual=level > 1))
            self.add_module(f"conv{level}", nn.Conv2d(width, _MIXED, kernel, padding=kernel // 2, bias=False))
            inputs = width
        head: list[nn.Module] = [nn.Conv2d(_MIXED * len(_WIDTHS), 8, 1, bias=False)]
        for channels, out in ((8, 4), (4, 4), (4, 1)):
            head += [nn.SELU(), nn.Conv2d(channels, out, 3, padding=1, bias=False)]
        self.score_head = nn.Sequential(*head)
        blocks = [_Block(3 if not i else _RANK_WIDTH, _RANK_WIDTH, residual=True) for i in range(_RANK_BLOCKS)]
        self.ranker_head = nn.Sequential(*blocks, nn.Conv2d(_RANK_WIDTH, 1, 5, padding=2, padding_mode="reflect"))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of points and their ranks, each (B, 1, H, W), of images (B, 3, H, W) in [0, 1].

        The padding to multiples of 32 repeats the border, on both sides, one pixel more at the right and at the bottom
        where it is odd.
        """
        height, width = image.shape[2:]
        right, bottom = -width % _MULTIPLE, -height % _MULTIPLE
        left, top = right // 2, bottom // 2
        mean, std = (torch.tensor(values)[:, None, None] for values in (_MEAN, _STD))
        x = F.pad((image - mean) / std, (left, right - left, top, bottom - top), mode="replicate")
        maps = self.score_head(self._pyramid(x)), self.ranker_head(x)
        logits, ranks = (map_[..., top : top + height, left : left + width] for map_ in maps)
        return logits, ranks

    def _pyramid(self, x: Tensor) -> Tensor:
        """(B, 128, H, W): what all levels see, those below enlarged so that corner pixels' centres coincide."""
        size, levels = x.shape[2:], []
        for level, pool in enumerate(_POOLS, 1):
            x = self.get_submodule(f"block{level}")(F.avg_pool2d(x, pool))
            mixed = F.selu(self.get_submodule(f"conv{level}")(x))
            levels.append(F.interpolate(mixed, size=size, mode="bilinear", align_corners=True))
        return torch.cat(levels, dim=1)


class _Block(nn.Module):
    """Two 3 x 3 convolutions, each normalised and through SELU; ``residual`` adds the input (by 1 x 1) before the last."""

    def __init__(self, inputs: int, width: int, residual: bool) -> None:
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(inputs, width, 3, padding=1, bias=False), nn.BatchNorm2d(width)
        self.conv2, self.bn2 = nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width)
        self.match_dims = nn.Conv2d(inputs, width, 1) if residual else None

    def forward(self, x: Tensor) -> Tensor:
        out = self.bn2(self.conv2(F.selu(self.bn1(self.conv1(x)))))
        return F.selu(out if self.match_dims is None else out + self.match_dims(x))
