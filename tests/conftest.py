from pathlib import Path

import pytest
from textured_scenes import ArraySequence, flight


@pytest.fixture(scope="session")
def short_flight() -> ArraySequence:
    """12 frames, 160 x 120, of a camera that moves and zooms over a plane: homographies are known."""
    return flight()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real sequences, for tests marked ``shared_data``."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no real sequences in ../shared/data beside the repository")
    return folder
