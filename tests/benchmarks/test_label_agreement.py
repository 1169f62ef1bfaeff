import runpy
from pathlib import Path

import numpy as np
import pytest
from stereo_scenes import StereoScene

from sips_lit.baselines.fast import Fast
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Inliers, Reason

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "label_agreement.py"))
LabelQuality, by_gap = SCRIPT["LabelQuality"], SCRIPT["by_gap"]
label_quality, pair_label_quality = SCRIPT["label_quality"], SCRIPT["pair_label_quality"]
I, L, F, U = Reason.INLIER, Reason.LOST, Reason.FAR, Reason.UNKNOWN  # noqa: E741 - a column of a table


def judged(*reasons: Reason) -> Inliers:
    reason = np.array(reasons, np.uint8)
    known = np.ones(len(reasons), np.bool_)
    return Inliers(reason == Reason.INLIER, reason, known, known)


def test_counts_by_hand():
    found = label_quality(judged(I, I, I, F, L, F, U, I), judged(I, I, F, I, F, L, I, U))
    assert found == LabelQuality(true_positives=2, false_positives=1, false_negatives=1, true_negatives=2, unknown=2)
    assert found.compared == 6
    assert found.precision == pytest.approx(2 / 3)
    assert found.recall == pytest.approx(2 / 3)


def test_false_alarms_and_misses():
    """Five inliers of which two are true, of the three that there are; three matches are rightly refused."""
    found = label_quality(judged(I, I, I, I, I, F, F, F, L), judged(I, I, F, F, L, I, F, F, F))
    assert (found.true_positives, found.false_positives, found.false_negatives, found.true_negatives) == (2, 3, 1, 3)
    assert (found.precision, found.recall) == (2 / 5, 2 / 3)


def test_nothing_is_nan():
    assert label_quality(judged(), judged()) == LabelQuality()
    assert np.isnan(LabelQuality(true_negatives=3).precision)
    assert np.isnan(LabelQuality(true_negatives=3).recall)
    assert LabelQuality(false_positives=1).precision == 0


def test_gaps_fall_into_ranges():
    ones = [LabelQuality(true_positives=10**i) for i in range(5)]
    rows = by_gap([1, 2, 3, 9, 4], ones, [1, 2, 4])
    assert [(name, pairs, found.true_positives) for name, pairs, found in rows] == [
        ("1", 1, 1),
        ("2 to 3", 2, 110),
        ("4 or more", 2, 11000),
    ]


@pytest.mark.parametrize("tells", ["stereo", "depth"])
def test_klt_finds_what_is_true_in_a_made_scene(tells):
    scene = StereoScene(4, tells)
    args = read_pair(scene, 0, 3), ShiTomasi(), RootSift(), KltInliers()
    found = pair_label_quality(*args, PoseDepthInliers(), 200)
    assert found.true_positives > 40
    assert found.precision > 0.9
    assert found.recall > 0.8


@pytest.mark.shared_data
@pytest.mark.parametrize("truth", [PoseDepthInliers(), StereoP3PInliers()], ids=["pose_depth", "stereo_p3p"])
@pytest.mark.parametrize("data", ["rgbd", "kitti"])
def test_klt_labels_agree_with_geometry_on_photographs(shared_data, data, truth):
    """Short gaps only: over longer ones the true poses of both data sets are off by more than the threshold."""
    if data == "rgbd":
        from sips_lit.datasets.rgbd import rgbd as load

        folder, pairs = shared_data / "rgbd_desk", [(10, 11), (40, 42), (60, 63)]
    else:
        from sips_lit.datasets.kitti import kitti as load

        folder, pairs = shared_data / "kitti_odometry", [(2, 3), (10, 11), (30, 31)]
    if not folder.is_dir():
        pytest.skip(f"no {folder.name} in ../shared/data")
    sequence = load(folder)[0]
    args = Fast(), RootSift(), KltInliers(), truth, 300
    found = sum((pair_label_quality(read_pair(sequence, i, j), *args) for i, j in pairs), LabelQuality())
    print(data, truth.protocol["inliers"], found, found.precision, found.recall)
    assert found.compared > 0.7 * (found.compared + found.unknown)
    assert found.precision > 0.9
    assert found.recall > 0.7
