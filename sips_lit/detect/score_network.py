"""The score network: image in, one logit a pixel out (paper, network section)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Literal, cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sips_lit.detect.derivatives import CHANNELS, derivative_channels, derivative_filters
from sips_lit.detect.detection_logits import Detection, detection_logits

Gradient = Literal["patches", "dense"]
Places = tuple[Tensor, Tensor]
"""Rows (N,) and columns (N,) of pixels."""


# a damaged checkpoint may ask for any number
MOST_LAYERS, MOST_SCALES, LARGEST_FACTOR = 1000, 32, 16
START_LOG_SIGMA = -1.0  # of an untrained covariance head: 0.37 pixels, about what sub-pixel points are off by
COVARIANCE_NUMBERS = 3  # log sigma_x, log sigma_y, and the inverse hyperbolic tangent of their correlation


class ScoreNetwork(nn.Module):
    """Fully convolutional 3x3 network whose sigmoid is the probability that a point is an inlier.

    ``depth`` layers, the last with one channel; the others have ``width / 2`` channels in the first half of the network
    and ``width`` in the second, each followed by a leaky ReLU. The last bias starts at ``start_bias`` (our choice). With
    ``scales > 1`` the same weights run on a pyramid with factor ``scale_factor`` (see `sips_lit.detect.selection`). With
    ``derivatives`` the first layer gets `derivative_channels` instead of the grey image alone (the paper's), and the
    receptive field grows by a pixel to each side. ``octaves``, ``first_octave``, ``octave_step``, ``corners``,
    ``fine_corners`` and ``whole_below`` say how a call makes the logits by which points are detected (see
    `sips_lit.detect.detection_logits`); what it learns from is the logit of the image alone, without corners. With
    ``covariance`` a second last layer, ``covariance_head``, gives three numbers a pixel of which
    `sips_lit.detect.covariance` makes the covariance of a point's place; logits stay what they are.

    Each octave is padded once by ``radius`` replicated pixels, then every convolution is a valid one: its logit of a pixel
    depends on exactly the (2 radius + 1)^2 pixels around it, and the same numbers come out of a dense pass and of patches.

    Raises ValueError for a depth below 2, an odd width, and other numbers out of range.
    """

    def __init__(
        self,
        depth: int = 10,
        width: int = 32,
        leaky_slope: float = 0.01,
        start_bias: float = -1.5,
        scales: int = 1,
        scale_factor: float = math.sqrt(2),
        derivatives: bool = False,
        octaves: int = 1,
        corners: float = 0.0,
        first_octave: float = 0,
        octave_step: float = 1,
        fine_corners: float = 0.0,
        whole_below: int = 0,
        covariance: bool = False,
    ) -> None:
        super().__init__()
        if depth not in range(2, MOST_LAYERS + 1) or width < 2 or width % 2:
            raise ValueError(
                f"a score network needs a depth of 2 to {MOST_LAYERS} and an even width >= 2, not {depth} and {width}"
            )
        if scales not in range(1, MOST_SCALES + 1) or not 1 < scale_factor <= LARGEST_FACTOR:
            raise ValueError(
                f"a pyramid needs 1 to {MOST_SCALES} scales and a scale_factor above 1 and up to {LARGEST_FACTOR}, not "
                f"{scales} and {scale_factor}"
            )
        self.detection = Detection(octaves, first_octave, octave_step, corners, fine_corners, whole_below)
        self.config: dict[str, Any] = {
            "depth": depth,
            "width": width,
            "leaky_slope": leaky_slope,
            "start_bias": start_bias,
            "scales": scales,
            "scale_factor": scale_factor,
            "derivatives": derivatives,
            **asdict(self.detection),
            "covariance": covariance,
        }
        self.derivatives = derivatives
        self.radius = depth + int(derivatives)
        self.leaky_slope = leaky_slope
        self.scales = scales
        self.scale_factor = scale_factor
        hidden = (width // 2 if layer < depth // 2 else width for layer in range(depth - 1))
        widths = [CHANNELS if derivatives else 1, *hidden, 1]
        self.layers = nn.ModuleList(nn.Conv2d(a, b, 3) for a, b in itertools.pairwise(widths))
        if derivatives:
            self.register_buffer("filters", derivative_filters(), persistent=False)
        with torch.no_grad():
            for layer in self.layers:
                nn.init.kaiming_normal_(cast(Tensor, layer.weight), a=leaky_slope)
                cast(Tensor, layer.bias).zero_()
            cast(Tensor, self.layers[-1].weight).mul_(0.1)  # logits start near the bias
            cast(Tensor, self.layers[-1].bias).fill_(start_bias)
        self.covariance_head: nn.Conv2d | None = None
        if covariance:  # made last: the other weights start as they do without it
            self.covariance_head = nn.Conv2d(widths[-2], COVARIANCE_NUMBERS, 3)
            nn.init.zeros_(self.covariance_head.weight)
            with torch.no_grad():
                cast(Tensor, self.covariance_head.bias).copy_(torch.tensor([START_LOG_SIGMA, START_LOG_SIGMA, 0.0]))
        for parameter in self.parameters():
            if parameter.ndim == 4:  # channels last halves the time on a CPU
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)

    def detecting_by(self, **asked: float | None) -> ScoreNetwork:
        """A network of the same weights with other ``scales``, or another part of its `Detection`; None: what it has.

        Raises ValueError for a number out of range.
        """
        given = {name: value for name, value in asked.items() if value is not None}
        network = ScoreNetwork(**{**self.config, **given})
        network.load_state_dict(self.state_dict())
        return network.train(self.training)

    def forward(self, image: Tensor) -> Tensor:
        """Logits (B, 1, H, W) float32 of grey images (B, 1, H, W) with values 0 to 255."""
        return detection_logits(self.octave, image, self.detection)

    def octave(self, image: Tensor) -> Tensor:
        """Logits (B, 1, H, W) of images (B, 1, H, W), or of an octave of them, by themselves."""
        return self.valid(self.pad(image))

    def pad(self, image: Tensor) -> Tensor:
        """Scaled image with ``radius`` replicated pixels on every side."""
        return F.pad(_scale(image), (self.radius,) * 4, mode="replicate")

    def interior(self, image: Tensor, margin: int) -> Tensor:
        """Logits (B, 1, H - 2 margin, W - 2 margin), of one octave, of pixels ``margin`` >= ``radius`` from every border.

        No pixel is replicated: they are those that the network gives within a larger image.
        """
        cut = margin - self.radius
        return self.valid(_scale(image[..., cut : image.shape[-2] - cut, cut : image.shape[-1] - cut]))

    def valid(self, padded: Tensor) -> Tensor:
        """Logits (B, 1, H, W) of padded, scaled images (B, 1, H + 2 radius, W + 2 radius)."""
        return self._last(self.layers[-1], self._hidden(padded))

    def _hidden(self, padded: Tensor) -> Tensor:
        """What the last layer sees, (B, C, H + 2, W + 2), of padded, scaled images."""
        x = padded
        if self.derivatives:
            with torch.autocast(x.device.type, enabled=False):  # differences of rounded grey values are noise
                x = derivative_channels(x.float(), cast(Tensor, self.filters))
        x = x.contiguous(memory_format=torch.channels_last)
        for layer in self.layers[:-1]:
            x = F.leaky_relu(layer(x), self.leaky_slope, inplace=not torch.is_grad_enabled())
        return x

    @staticmethod
    def _last(layer: nn.Module, hidden: Tensor) -> Tensor:
        # float32 under autocast, too: equal logits would make the order of the points arbitrary
        with torch.autocast(hidden.device.type, enabled=False):
            output: Tensor = layer(hidden.float())
        return output

    def at(self, images: Sequence[Tensor], places: Sequence[Places], gradient: Gradient) -> list[Tensor]:
        """Logits (N,), of one octave, at N pixels of each image (1, 1, H, W), differentiable, by the route ``gradient``.

        ``dense`` evaluates whole images, those of one size together, and gathers; ``patches`` evaluates the receptive fields
        of all pixels together. Both give the same logits and gradients; which is faster depends on the network, the image
        and the machine.
        """
        if gradient == "dense":
            maps: dict[int, Tensor] = {}
            by_size = sorted(range(len(images)), key=lambda i: images[i].shape)
            for _, same in itertools.groupby(by_size, key=lambda i: images[i].shape):
                order = list(same)
                maps |= dict(zip(order, self.octave(torch.cat([images[i] for i in order])), strict=True))
            return [maps[i][0][at] for i, at in enumerate(places)]
        windows = [self._windows(image, *at) for image, at in zip(images, places, strict=True)]
        return list(torch.split(self.valid(torch.cat(windows)).flatten(), [len(of_image) for of_image in windows]))

    def covariance_numbers(self, image: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """Outputs (N, 3) of the covariance head at N pixels of one image (1, 1, H, W), by their receptive fields.

        Only the head gets a gradient: scores are not traded for it. Raises ValueError for a network without that head.
        """
        if self.covariance_head is None:
            raise ValueError("the score network has no covariance head")
        with torch.no_grad():
            hidden = self._hidden(self._windows(image, rows, columns))
        return self._last(self.covariance_head, hidden).flatten(1)

    def logits_and_covariance_numbers(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (B, 1, H, W) of images (B, 1, H, W) as a call gives them, and outputs (B, 3, H, W) of the covariance head.

        Raises ValueError for a network without that head.
        """
        if self.covariance_head is None:
            raise ValueError("the score network has no covariance head")
        of_image: list[Tensor] = []

        def octave(level: Tensor) -> Tensor:
            hidden = self._hidden(self.pad(level))
            if level is image:
                of_image.append(hidden)
            return self._last(self.layers[-1], hidden)

        logits = detection_logits(octave, image, self.detection)
        hidden = of_image[0] if of_image else self._hidden(self.pad(image))
        return logits, self._last(self.covariance_head, hidden)

    def _windows(self, image: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """The padded, scaled receptive fields (N, 1, 2 radius + 1, 2 radius + 1) of N pixels."""
        size = 2 * self.radius + 1
        windows = self.pad(image)[0, 0].unfold(0, size, 1).unfold(1, size, 1)
        return windows[rows, columns].unsqueeze(1)


def _scale(image: Tensor) -> Tensor:
    """Grey values 0 to 255 as the first layer gets them."""
    return (image - 127.0) / 64.0
