from pathlib import Path

import pytest
from textured_scenes import flight
from video_files import write_video


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of 12 frames, 160 x 120, in one shot."""
    return write_video(tmp_path_factory.mktemp("videos") / "clip.avi", flight().frames)
