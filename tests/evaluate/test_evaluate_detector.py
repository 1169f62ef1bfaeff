import numpy as np
import pytest
from textured_scenes import flight

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.runner import evaluate_detector
from sips_lit.inliers.homography import HomographyInliers

DATA = [flight(8, size=(128, 96), name="a"), flight(6, size=(100, 90), seed=2, name="b")]
FEW = Measures(k=8, ks=(), n_max=60, n=20)


def test_one_call_is_an_evaluation(tmp_path):
    found = evaluate_detector(ShiTomasi(), DATA, HomographyInliers(), RootSift(), pairs=5, measures=FEW)
    assert (found.name, found.key) == ("Shi-Tomasi + RootSIFT", "shi-tomasi_rootsift")
    assert found.n_k.shape == (5, 1, 1)
    assert np.isfinite(found.n_k).any()
    assert (found.protocol["overlap"], found.protocol["seed"], found.protocol["k"]) == (0.5, 0, 8)
    again = evaluate_detector(
        ShiTomasi(), DATA, HomographyInliers(), RootSift(), pairs=5, measures=FEW, index_folder=tmp_path
    )
    np.testing.assert_array_equal(again.n_k, found.n_k)
    assert list(tmp_path.iterdir())


def test_what_can_not_be_evaluated():
    with pytest.raises(BadInputError, match="does not describe them: choose descriptor="):
        evaluate_detector(ShiTomasi(), DATA, HomographyInliers(), pairs=2, measures=FEW)
    with pytest.raises(BadInputError, match="no sequence"):
        evaluate_detector(ShiTomasi(), [], HomographyInliers(), RootSift())
    with pytest.raises(BadInputError, match="pairs is 0"):
        evaluate_detector(ShiTomasi(), DATA, HomographyInliers(), RootSift(), pairs=0)
