import numpy as np
import pytest
from overlap_rows import index_of
from textured_scenes import ArraySequence, Damaged, texture

from sips_lit.dataset_tools.stats import GAPS, draw_stats, overlap_by_gap, pixel_steps, pose_steps, sequence_stats
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap
from sips_lit.tracking.klt import KltTracker


def panning(frames: int = 8, step: int = 6) -> ArraySequence:
    """A window of 160 x 120 that moves ``step`` pixels a frame over a texture: overlap and motion are known."""
    wide = texture(120, 160 + frames * step)
    return ArraySequence([wide[:, i * step : i * step + 160].copy() for i in range(frames)])


def test_motion_of_a_panning_window_is_its_step():
    assert pixel_steps(panning(), KltTracker()) == pytest.approx(6, abs=0.1)


def test_overlap_by_gap_of_a_hand_made_index():
    # three frames of 10 points: 8 and 4 survive of the first, 6 of the second
    index = index_of([[8, 4], [6], []])
    table = overlap_by_gap(index)
    assert table[GAPS.index(1)] == pytest.approx([0.65, 0.7, 0.75])
    assert table[GAPS.index(2)] == pytest.approx([0.4, 0.4, 0.4])
    assert np.isnan(table[GAPS.index(5)]).all()


def test_steps_of_poses():
    class Turning(ArraySequence):
        def pose(self, index):
            angle = 1e-4 * index
            T = np.eye(4)
            T[:3, :3] = [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
            T[2, 3] = 2.0 * index
            return T

    metres, degrees = pose_steps(Turning(panning(4).frames))
    np.testing.assert_allclose(metres, 2)
    np.testing.assert_allclose(degrees, np.degrees(1e-4), rtol=1e-9)


def test_a_sequence_without_poses_or_texture():
    flat = ArraySequence([np.full((60, 80), 9, np.uint8)] * 3)
    stats = sequence_stats(flat, measure_overlap(flat, OverlapParameters()))
    assert (len(stats.pixels), len(stats.metres), len(stats.degrees)) == (0, 0, 0)
    assert draw_stats([stats]).axes


def test_frames_that_cannot_be_read_are_left_out():
    damaged = Damaged(panning().frames)
    damaged.bad = (3,)
    stats = sequence_stats(damaged, measure_overlap(damaged, OverlapParameters()))
    assert stats.pixels == pytest.approx([6] * 5, abs=0.1)  # of 7 steps, two are to and from frame 3
    assert draw_stats([stats]).axes


@pytest.mark.parametrize("frames", [0, 1])
def test_a_sequence_without_a_pair(frames):
    short = ArraySequence(panning().frames[:frames])
    assert len(pixel_steps(short, KltTracker())) == 0


def test_the_picture_shows_every_sequence():
    sequence = panning()
    stats = sequence_stats(sequence, measure_overlap(sequence, OverlapParameters()))
    figure = draw_stats([stats] * 3)
    assert len(figure.axes[1].lines) == 3
    assert stats.overlap[0, 1] > stats.overlap[1, 1] > 0


def test_the_spread_of_the_pairs_is_that_of_the_index():
    sequence = panning()
    stats = sequence_stats(sequence, measure_overlap(sequence, OverlapParameters()))
    assert stats.spread.pairs == stats.reach_training.sum()
    assert stats.spread.motion[0, 0] == pytest.approx(6, abs=0.1)
    assert len(draw_stats([stats]).axes[3].lines) == 1
