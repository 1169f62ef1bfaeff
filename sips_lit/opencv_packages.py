"""Which packages of OpenCV are installed: of the four, which all write the folder ``cv2``, only one can be whole."""

from __future__ import annotations

import importlib.metadata
import shlex
import warnings
from typing import Final

from sips_lit.errors import InputWarning

OPENCV: Final = ("opencv-python", "opencv-contrib-python", "opencv-python-headless", "opencv-contrib-python-headless")


def installed_opencv() -> list[str]:
    """Those of `OPENCV` that are installed."""
    return [name for name in OPENCV if _is_installed(name)]


def _is_installed(name: str) -> bool:
    try:
        importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def warn_of_several() -> None:
    """Warns where several are installed, with the commands that leave the one with windows, or else the first."""
    found = installed_opencv()
    if len(found) > 1:
        keep = found[0]
        warnings.warn(
            f"{' and '.join(found)} are installed and share the folder cv2, so one of them is broken (often cv2.imshow): "
            f"keep one, any will do: {shlex.join(['pip', 'uninstall', '-y', *found])} && pip install --no-deps {keep}",
            InputWarning,
            stacklevel=2,
        )
