import runpy
from dataclasses import replace

import pytest
from cli_runs import ROOT
from textured_scenes import flight
from video_files import write_video


@pytest.fixture(scope="module")
def many_videos():
    return runpy.run_path(str(ROOT / "benchmarks" / "many_videos.py"))


@pytest.fixture(scope="module")
def measured(many_videos, tmp_path_factory):
    root = tmp_path_factory.mktemp("many")
    clips = [write_video(root / f"{name}.avi", flight(16, size=(96, 80), name=name).frames) for name in "ab"]
    many_videos["link_videos"](root, clips, 20)
    many_videos["measure"].__globals__["DRAWS"] = 10
    with pytest.warns(UserWarning, match="left out: .*broken0"):
        return many_videos["measure"](root, 15)


def test_links_are_trained_on_without_decoding_or_tracking(measured):
    assert measured.videos == 15
    assert measured.again > 0
    assert measured.draw > 0


def test_each_limit_can_be_missed(many_videos, measured, capsys):
    fine = replace(measured, start=1.0, before=100.0, after=110.0, later=111.0, draw=1.0, files=5)
    many_videos["report"]([fine, fine], many_videos["BROKEN"])
    assert "seconds to start a training: 1.00 (limit 60)" in capsys.readouterr().out
    for change in ({"start": 61.0}, {"after": 300.0, "later": 301.0}, {"later": 210.0}, {"draw": 1.6}, {"files": 6}):
        with pytest.raises(SystemExit, match="over the limit"):
            many_videos["report"]([fine, replace(fine, **change)], many_videos["BROKEN"])
    with pytest.raises(SystemExit, match="lines of warnings"):
        many_videos["report"]([fine, fine], many_videos["BROKEN"] + 1)
