import numpy as np
import pytest

from sips_lit.cli import peak_memory as module
from sips_lit.cli.peak_memory import peak_memory
from sips_lit.errors import InputWarning

IMAGE = np.zeros((40, 60), np.uint8)


def test_numbers_of_megabytes():
    """Of NumPy and OpenCV alone some tens; of an image of 64 MB as many more."""
    if not module._STATUS.is_file():
        pytest.skip("tells only on Linux")
    orb = {"_target_": "sips_lit.baselines.orb.OrbDetector"}
    small, large = (peak_memory(orb, image, 5, 1) for image in (IMAGE, np.zeros((8000, 8000), np.uint8)))
    assert 20 < small < 200
    assert large > small + 64


def test_a_process_that_fails_is_told_of():
    if not module._STATUS.is_file():
        pytest.skip("tells only on Linux")
    with pytest.warns(InputWarning, match=r"the memory of thing could not be measured: .*no"):
        assert peak_memory({"_target_": "no.such.thing"}, IMAGE, 5, 1) is None


def test_another_package_of_the_name_in_the_working_folder_is_left_alone(tmp_path, monkeypatch):
    if not module._STATUS.is_file():
        pytest.skip("tells only on Linux")
    (tmp_path / "sips_lit").mkdir()
    (tmp_path / "sips_lit" / "__init__.py").write_text("raise RuntimeError('an old clone')")
    monkeypatch.chdir(tmp_path)
    assert peak_memory({"_target_": "sips_lit.baselines.orb.OrbDetector"}, IMAGE, 5, 1) > 20


def test_other_systems_do_not_tell(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "_STATUS", tmp_path / "none")
    assert peak_memory({}, IMAGE, 5, 1) is None
