"""Peak resident memory of a command with all its processes: python benchmarks/memory.py -- sips-train ..."""

from __future__ import annotations

import subprocess
import sys
import time

import psutil


def resident(process: psutil.Process) -> tuple[int, int]:
    """Sum of resident memory of a process and its children, and the same with shared pages split among them."""
    rss = pss = 0
    for each in [process, *process.children(recursive=True)]:
        try:
            info = each.memory_full_info()
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
        rss += info.rss
        pss += getattr(info, "pss", info.rss)
    return rss, pss


def main() -> None:
    command = [argument for argument in sys.argv[1:] if argument != "--"]
    if not command:
        sys.exit(__doc__)
    child = subprocess.Popen(command)
    process, peak_rss, peak_pss = psutil.Process(child.pid), 0, 0
    while child.poll() is None:
        try:
            rss, pss = resident(process)
        except psutil.NoSuchProcess:
            break
        peak_rss, peak_pss = max(peak_rss, rss), max(peak_pss, pss)
        time.sleep(0.5)
    print(
        f"peak resident memory: {peak_pss / 1e9:.2f} GB ({peak_rss / 1e9:.2f} GB with shared pages counted per process)"
    )
    sys.exit(child.wait())


if __name__ == "__main__":
    main()
