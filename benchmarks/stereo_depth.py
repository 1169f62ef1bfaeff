"""Disparity of single points: time, how many are known, and how far they are from dense semi-global matching.

    python benchmarks/stereo_depth.py DATA PATH [FRAMES]          DATA: kitti, euroc

Without arguments on the stereo photograph of scikit-image (extra demo), against its true disparity.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from tabulate import tabulate

from sips_lit.baselines.controls import RandomPoints
from sips_lit.baselines.fast import Fast
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.geometry.projection import sample_depth
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.types import GreyImage

POINTS, MOST = 500, 192


def semi_global(left: GreyImage, right: GreyImage) -> np.ndarray:
    """OpenCV's dense disparity (H, W), NaN where unknown or below half a pixel."""
    wide = [cv2.copyMakeBorder(image, 0, 0, MOST, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    disparity = cv2.StereoSGBM_create(0, MOST, 5, 200, 800, 1, 63, 10, 100, 2).compute(*wide)[:, MOST:] / 16
    return np.where(disparity > 0.5, disparity, np.nan)


def photograph() -> Iterator[tuple[GreyImage, GreyImage, np.ndarray]]:
    import skimage

    folder = Path(skimage.__file__).parent / "data"
    left, right = (cv2.imread(str(folder / f"motorcycle_{s}.png"), cv2.IMREAD_GRAYSCALE) for s in ("left", "right"))
    assert left is not None
    assert right is not None
    yield left, right, np.load(folder / "motorcycle_disp.npz")["arr_0"]


def frames(data: str, path: str, count: int) -> Iterator[tuple[GreyImage, GreyImage, np.ndarray]]:
    sequence = getattr(importlib.import_module(f"sips_lit.datasets.{data}"), data)(path)[0]
    for index in np.linspace(0, len(sequence) - 1, count).astype(int):
        left, right = sequence.frame(index), sequence.right(index)
        yield left, right, semi_global(left, right)


def main() -> None:
    given = sys.argv[1:]
    if len(given) not in (0, 2, 3):
        sys.exit(__doc__)
    scenes = list(frames(given[0], given[1], int(given[2]) if len(given) == 3 else 6) if given else photograph())
    matcher, rows = StereoMatcher(), []
    for detector in (ShiTomasi(), Fast(), RandomPoints()):
        seconds, known, errors = [], [], []
        for left, right, reference in scenes:
            xy = detector.detect(left, POINTS).xy
            begin = time.perf_counter()
            disparity = matcher.disparity(left, right, xy)
            seconds.append(time.perf_counter() - begin)
            known.append(np.isfinite(disparity))
            errors.append(np.abs(disparity - sample_depth(reference, xy)))
        error = np.concatenate(errors)
        error = error[np.isfinite(error)]
        share = np.concatenate(known).mean()
        rows.append(
            [detector.name, 1e3 * np.median(seconds), share, np.median(error), (error > 1).mean(), (error > 3).mean()]
        )
    headers = ["points", f"ms for {POINTS}", "known", "median error, px", "off by > 1 px", "> 3 px"]
    print(f"against {'semi-global matching' if given else 'true disparity'}, {len(scenes)} images\n")
    print(tabulate(rows, headers=headers, tablefmt="github", floatfmt=(".0f", ".1f", ".3f", ".3f", ".3f", ".3f")))


if __name__ == "__main__":
    main()
