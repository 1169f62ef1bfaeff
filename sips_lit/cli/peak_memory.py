"""How much memory a detector needs at most: it is made and run in a process of its own, which loads nothing else."""

from __future__ import annotations

import pickle
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, Final

import hydra

from sips_lit.errors import warn_input
from sips_lit.types import GreyImage

_STATUS: Final = Path("/proc/self/status")  # getrusage has the peak of the parent, too
_BARE: Final = "from pathlib import Path; print(Path('/proc/self/status').read_text())"


def peak_memory(detector: dict[str, Any], image: GreyImage, n: int, threads: int) -> float | None:
    """Megabytes (10^6 bytes) above a bare interpreter, libraries included, of finding ``n`` points twice.

    ``detector``: its plain configuration. None where the system does not tell (it is not Linux), or, with a
    warning, where its process fails.
    """
    if not _STATUS.is_file():
        return None
    given = pickle.dumps((detector, image, n, threads))
    # -P: not whatever is called sips_lit in the working folder
    done = subprocess.run([sys.executable, "-P", "-m", __name__], input=given, capture_output=True, check=False)
    if done.returncode:
        *_, last = done.stderr.decode(errors="replace").split("\n")[:-1] or [f"exit code {done.returncode}"]
        warn_input(f"the memory of {detector['_target_'].rpartition('.')[2]} could not be measured: {last}")
        return None
    return (_peak(done.stdout.decode()) - _bare()) / 1e6


@cache
def _bare() -> int:
    return _peak(subprocess.run([sys.executable, "-c", _BARE], capture_output=True, text=True, check=True).stdout)


def _peak(status: str) -> int:
    """Bytes."""
    (line,) = (line for line in status.splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(line.split()[1])


def _detect(config: dict[str, Any], image: GreyImage, n: int, threads: int) -> None:
    detector = hydra.utils.instantiate(config, _convert_="all")
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)
    for _ in range(2):
        detector.detect(image, n)


if __name__ == "__main__":
    _detect(*pickle.load(sys.stdin.buffer))
    print(_STATUS.read_text())
