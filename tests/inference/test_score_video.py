import cv2
import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.inference.score_video import draw_scores, write_score_video
from sips_lit.render.canvas import probability_colours


@pytest.fixture(scope="module")
def sips() -> SipsDetector:
    torch.manual_seed(0)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


def frames_of(path) -> list[np.ndarray]:
    video, frames = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    return frames


def test_frames_beside_their_scores(tmp_path, sips):
    scene = flight(6)
    path = tmp_path / "new" / "scores.mp4"
    assert write_score_video(path, scene, sips, n=10, max_frames=4) == 4
    frames = frames_of(path)
    assert [frame.shape for frame in frames] == [(120, 320, 3)] * 4
    for index, frame in enumerate(frames):  # every frame on its own, but for the compression
        assert np.abs(frame.astype(int) - draw_scores(scene.frame(index), sips, 10)).mean() < 12
    assert [p.name for p in path.parent.iterdir()] == ["scores.mp4"]


def test_the_right_half_is_the_score_map(sips):
    image = flight(1).frame(0)
    picture = draw_scores(image, sips, 0)
    np.testing.assert_array_equal(picture[:, 160:], probability_colours(sips.score_map(image)))
    assert (draw_scores(image, sips, 10)[:, 160:] != picture[:, 160:]).any()


def test_other_detectors_show_their_points(tmp_path):
    assert draw_scores(flight(1).frame(0), ShiTomasi(), 20).shape == (120, 160, 3)
    assert write_score_video(tmp_path / "p.mp4", flight(2), ShiTomasi()) == 2


def test_what_cannot_be_a_video(tmp_path, sips):
    with pytest.raises(BadInputError, match="at least one"):
        write_score_video(tmp_path / "v.mp4", flight(2), sips, max_frames=0)
    sizes = ArraySequence([np.zeros((40, 60), np.uint8), np.zeros((60, 40), np.uint8)], "mixed")
    with pytest.raises(BadInputError, match="frame 1 of mixed differs in size"):
        write_score_video(tmp_path / "v.mp4", sizes, sips)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(BadInputError, match="cannot write a video"):
        write_score_video(tmp_path / "v.nonsense", flight(2), sips)
