import subprocess
import sys
from pathlib import Path

import pytest
from markdown_code import ROOT

from sips_lit.opencv_packages import OPENCV, installed_opencv


def install(folder: Path, name: str) -> None:
    """What pip leaves of a package beside its files."""
    info = folder / f"{name.replace('-', '_')}-4.14.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 4.14.0\n")


def imported(folder: Path) -> str:
    """What standard error says when the package is imported where only the packages of a folder are installed."""
    code = f"import importlib, sys; sys.path += [{str(folder)!r}, {str(ROOT)!r}]; "
    code += "import sips_lit; importlib.reload(sips_lit)"
    run = subprocess.run([sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stderr


@pytest.mark.parametrize("names", [(), *((name,) for name in OPENCV)])
def test_one_package_or_none_is_fine(tmp_path, names):
    for name in names:
        install(tmp_path, name)
    assert imported(tmp_path) == ""


def test_two_packages_are_told_once_with_the_remedy(tmp_path):
    install(tmp_path, "opencv-contrib-python")
    install(tmp_path, "opencv-python-headless")
    text = imported(tmp_path)
    assert text.count("are installed and share the folder cv2") == 1
    assert (
        "pip uninstall -y opencv-contrib-python opencv-python-headless && pip install --no-deps opencv-contrib-python"
        in text
    )


def test_here_is_at_least_one():
    assert installed_opencv()
