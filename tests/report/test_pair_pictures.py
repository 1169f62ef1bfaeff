import cv2
import numpy as np
from benchmark_examples import detector_result, pair_table
from textured_scenes import flight
from tiny_methods import MEASURES, METHODS

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.evaluate.features import extract
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.report.pair_pictures import choose_pairs, draw_method_pictures, draw_pair_pictures
from sips_lit.report.summary import median_needed
from sips_lit.types import FramePair


def test_best_median_and_worst():
    assert choose_pairs(np.array([30, 12, np.inf, 20, 40.0])) == {"best": 1, "median": 0, "worst": 2}
    assert choose_pairs(np.array([30.0, 12])) == {"best": 1, "worst": 0}
    assert choose_pairs(np.array([np.inf])) == {"best": 0}
    assert choose_pairs(np.zeros(0)) == {}


def test_pictures_show_the_pairs_that_they_name():
    scene = flight(4)
    result = detector_result("Shi-Tomasi + RootSIFT", pair_table(np.random.default_rng(0), 3), quality=0.2)
    asked = []

    def pair_of(index):
        asked.append(index)
        ends = (scene.frame(0), scene.frame(index + 1))
        return FramePair("p", 0, index + 1, ends, *ends, scene.homography(0, index + 1)), HomographyInliers()

    def features_of(image):
        return extract(ShiTomasi(), RootSift(), image, 60).features

    plain = draw_pair_pictures(result, pair_of, features_of, 30)
    needed = median_needed(result, 10)
    assert needed[asked].tolist() == sorted(needed.tolist())
    assert [p.label for p in plain] == ["best", "median", "worst"]
    for picture, index in zip(plain, asked, strict=True):
        assert picture.caption.startswith(result.pairs.name[index])
        assert f"{needed[index]:g}" in picture.caption or "never" in picture.caption
        assert picture.image.shape[1] >= 320
    green = (plain[0].image.astype(int) - (0, 205, 140)).__abs__().max(axis=2) < 60
    assert green.sum() > 100  # inliers
    mapped = draw_pair_pictures(
        result, pair_of, features_of, 30, lambda image: cv2.blur(image / np.float32(255), (5, 5))
    )
    assert mapped[0].image.shape[0] >= plain[0].image.shape[0] + 120


def test_pictures_of_each_method(measured_flights, benchmark_folder):
    pairs, measured = measured_flights
    pictures = draw_method_pictures(measured[:2], METHODS, pairs, MEASURES, benchmark_folder / "features")
    assert set(pictures) == {"sips", "corners"}
    assert [picture.label for picture in pictures["sips"]] == ["best", "median", "worst"]
    assert all(picture.image.ndim == 3 for of in pictures.values() for picture in of)
