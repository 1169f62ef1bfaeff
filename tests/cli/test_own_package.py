"""A detector, a descriptor, a data set and a label source of the user's own, in his package, in every command."""

import csv
import json

import pytest
from cli_runs import TINY

CODE = """
import cv2
import numpy as np

from sips_lit.detect.base import BaseDetector
from sips_lit.inliers.independent import IndependentCheck
from sips_lit.types import ImageSequence, Inliers, Keypoints, Reason


class Blobs(BaseDetector):
    name = "Blobs"

    def __init__(self, sigma=2.0):
        self.sigma = sigma

    def detect(self, image, n):
        corners = cv2.goodFeaturesToTrack(cv2.GaussianBlur(image, (0, 0), self.sigma), max(n, 1), 1e-4, 3)
        xy = np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2)[:n]
        return Keypoints(xy.astype(np.float32), np.arange(len(xy), 0, -1, dtype=np.float32), np.ones(len(xy), np.float32))


class Careless(Blobs):
    name = "Careless"

    def detect(self, image, n):
        good = super().detect(image, n)
        xy, score = good.xy, good.score
        xy, score = np.concatenate([xy[:5] * np.nan, xy]), np.concatenate([score[:5] + 99, score])
        xy, score = np.concatenate([xy[-3:] + 1000, xy]), np.concatenate([score[-3:] + 99, score])
        xy, score = np.repeat(xy, 2, 0), np.repeat(score, 2)
        order = np.random.default_rng(0).permutation(len(xy))
        xy, score = xy[order], score[order]
        return Keypoints(xy, score, np.ones(len(xy), np.float32))


class Patch:
    name, norm = "Patch", "l2"

    def describe(self, image, keypoints):
        patches = [cv2.getRectSubPix(image, (11, 11), (float(x), float(y))).ravel() for x, y in keypoints.xy]
        return np.array(patches, np.float32).reshape(len(keypoints), 121)


class Pan(ImageSequence):
    name, fingerprint = "pan", "pan-1"

    def __init__(self, seed):
        self.world = cv2.resize(np.random.default_rng(seed).integers(0, 255, (40, 60), np.uint8), (360, 240))

    def __len__(self):
        return 16

    def frame(self, index):
        return np.ascontiguousarray(self.world[20 + index : 116 + index, 20 + 2 * index : 148 + 2 * index])


def pan(seed=0):
    return [Pan(seed)]


class KnownPan(IndependentCheck):
    @property
    def protocol(self):
        return {"inliers": "known_pan"}

    def __call__(self, pair, keypoints0, keypoints1, matches):
        shift = (pair.index0 - pair.index1) * np.array([2, 1])
        error = keypoints0.xy[matches.index0] + shift - keypoints1.xy[matches.index1]
        near = (np.abs(error) <= 2).all(1)
        reason = np.where(near, Reason.INLIER, Reason.FAR).astype(np.uint8)
        return Inliers(near, reason, np.ones(len(keypoints0), bool), np.ones(len(keypoints1), bool))
"""
CONF = {
    "detector/blobs": "_target_: my_points.parts.Blobs\nsigma: 1.5\n",
    "detector/careless": "_target_: my_points.parts.Careless\nsigma: 1.5\n",
    "descriptor/patch": "_target_: my_points.parts.Patch\n",
    "data/pan": "_target_: my_points.parts.pan\nseed: 3\n",
    "inliers/known_pan": "_target_: my_points.parts.KnownPan\n",
}
MINE = ("hydra.searchpath=[pkg://my_points.conf]", "data=pan", "inliers=known_pan", "descriptor=patch")
SMALL = ("pairs=4", "n_max=60", "n=20", "ks=[5]", "calibration=[20]", "pictures=false")


@pytest.fixture
def package(folders):
    """Puts the package my_points where the commands are started, and Python finds it."""
    for name in ("my_points", "my_points/conf"):
        (folders / name).mkdir()
        (folders / name / "__init__.py").touch()
    (folders / "my_points" / "parts.py").write_text(CODE)
    for name, text in CONF.items():
        path = folders / "my_points" / "conf" / f"{name}.yaml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


@pytest.fixture
def run(package, process, tmp_path):
    """Runs a command as a process."""

    def start(name, *arguments):
        child = process(name, *arguments, f"hydra.run.dir={tmp_path}/{name}")
        code = child.wait(timeout=300)
        out = child.log.read_text()
        assert code == 0, out[-3000:]
        return out

    return start


def test_a_benchmark(run, tmp_path):
    out = run(
        "benchmark", *MINE, *SMALL, "detectors=[blobs,shi_tomasi,{wide:{_target_:my_points.parts.Blobs,sigma:4}}]"
    )
    for name in ("\nBlobs + Patch ", "\nShi-Tomasi + Patch ", "\nBlobs (sigma 4) + Patch "):
        assert name in out
    (pair_set,) = json.loads((tmp_path / "benchmark" / "results.json").read_text())["pair_sets"]
    assert pair_set["protocol"]["verification"] == [{"inliers": "known_pan"}]
    assert pair_set["protocol"]["sequences"] == ["pan"]
    assert all(n != "inf" for method in pair_set["detectors"] for (needed,) in method["n_k"] for n in needed)


def needed(path):
    with path.open() as handle:
        return [row["nmin"] for row in csv.DictReader(handle)]


def test_points_are_sanitised_alike_in_every_command_and_that_is_said(run, tmp_path):
    """Blank, outside, duplicate and unsorted points give the numbers of the same corners in order, in both commands."""
    one = run("evaluate", *MINE, *SMALL, "detector=careless")
    many = run("benchmark", *MINE, *SMALL, "detectors=[blobs,careless]")
    (said,) = [line for line in one.splitlines() if line.startswith("sanitised: ")]
    assert said in many.splitlines()
    for defect in ("Careless + Patch: ", "invalid", "outside", "duplicates", "sorted the points of"):
        assert defect in said
    good, careless, alone = (
        needed(tmp_path / path)
        for path in (
            "benchmark/pan/blobs_patch_pairs.csv",
            "benchmark/pan/careless_patch_pairs.csv",
            "evaluate/pan/careless_patch_pairs.csv",
        )
    )
    assert alone == careless == good
    assert "inf" not in good


def test_an_evaluation(run):
    out = run("evaluate", *MINE, *SMALL, "detector=blobs", "detector.sigma=2")
    assert "\nBlobs + Patch " in out


def test_overlap_and_training(run, tmp_path):
    assert "| pan " in run("index", *MINE[:2])
    out = run("train", *MINE, *TINY, "datamodule.overlap=0.3")
    assert "best validation AUC" in out
    assert (tmp_path / "train" / "checkpoints" / "last.ckpt").stat().st_size
