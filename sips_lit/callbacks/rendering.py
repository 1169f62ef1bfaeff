"""Match pictures of some validation pairs, in TensorBoard and as PNG files of the run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import lightning as L

from sips_lit.callbacks.tensorboard import show
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import score_map
from sips_lit.files import make_folder, write_whole
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.render.matches import draw_matches


class MatchPictures(L.Callback):
    """Draws the first ``count`` validation pairs with their ``n`` best points.

    Both images and score maps, circles as thick as the probability, lines for inliers. PNG files go to ``folder`` and show
    the last validation; TensorBoard keeps all. ``folder`` may be None. Raises BadInputError where it can't be written.
    """

    def __init__(self, count: int = 4, n: int = 50, folder: str | Path | None = None) -> None:
        self.count, self.n = count, n
        self.folder = None if folder is None else Path(folder)

    def on_validation_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int, *_: Any
    ) -> None:
        """Draws the pair."""
        if outputs is None or batch_idx >= self.count or not trainer.is_global_zero:
            return
        assert isinstance(outputs, VerifiedPair)
        network = pl_module.network
        assert isinstance(network, ScoreNetwork)
        pair, best0, best1 = outputs.pair, outputs.features0.best(self.n), outputs.features1.best(self.n)
        matches, inliers = outputs.at(self.n)
        sides = pair.image0, pair.image1, best0.keypoints, best1.keypoints
        map0, map1 = (score_map(network, image, device=pl_module.device) for image in (pair.image0, pair.image1))
        picture = draw_matches(*sides, matches, inliers, map0, map1, pair.name)
        show(trainer, f"val/pair_{batch_idx}", picture)
        if self.folder is not None:
            make_folder(self.folder)
            png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1]
            write_whole(self.folder / f"matches_{batch_idx}.png", png.tobytes())
