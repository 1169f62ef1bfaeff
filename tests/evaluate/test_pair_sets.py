import numpy as np
import pytest
from textured_scenes import ArraySequence, flight, texture

from sips_lit.errors import BadInputError
from sips_lit.evaluate.pairs import draw_pairs
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers


def sequence(**options) -> ArraySequence:
    return flight(8, size=(96, 80), **options)


def test_pairs_are_fixed_by_the_seed(tmp_path):
    def names(count, seed=0):
        return [pair.name for pair, _ in draw_pairs([sequence()], KltInliers(), tmp_path, count, 0.4, seed)]

    assert names(10) == names(10)
    assert len(set(names(10))) == 10
    assert names(4) == names(10)[:4]
    assert names(10, seed=1) != names(10)


def test_pairs_can_be_gone_through_again(tmp_path):
    pairs = draw_pairs([sequence()], KltInliers(), tmp_path, 5, 0.4)
    one, two = list(pairs), list(pairs)
    assert len(one) == len(pairs) == 5
    for (a, check), (b, _) in zip(one, two, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.image1, b.image1)
        assert check is pairs.checks[0]


def test_fewer_pairs_than_asked_for(tmp_path):
    pairs = draw_pairs([flight(3)], HomographyInliers(), tmp_path, 500, 0.1)
    assert len(pairs) == pairs.protocol["pairs"] == 6


def test_frames_between_are_read_only_for_tracks(tmp_path):
    for check, between in ((KltInliers(), True), (HomographyInliers(), False)):
        for pair, _ in draw_pairs([sequence()], check, tmp_path, 8, 0.3):
            distance = abs(pair.index1 - pair.index0)
            assert len(pair.frames) == (distance + 1 if between else 2)


def test_no_pair_overlaps(tmp_path):
    cuts = ArraySequence([texture(80, 96, i) for i in range(5)], "cuts")
    with pytest.raises(BadInputError, match=r"no two frames of cuts overlap by 0\.5"):
        draw_pairs([cuts], KltInliers(), tmp_path, 5, 0.5)


def test_no_sequence(tmp_path):
    with pytest.raises(BadInputError, match="no sequence"):
        draw_pairs([], KltInliers(), tmp_path, 5, 0.5)


def test_evaluations_need_every_frame(tmp_path):
    class Damaged(ArraySequence):
        def frame(self, index):
            if index == 3:
                raise BadInputError("walk/003.png is damaged")
            return super().frame(index)

    with pytest.raises(BadInputError, match=r"an evaluation needs every frame, but walk/003\.png is damaged"):
        draw_pairs([sequence(known=False), Damaged(flight(9).frames, "walk")], KltInliers(), tmp_path, 5, 0.4)
