"""What several processes that share the tests need, and what takes long to make."""

from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

folder: Path | None = None
"""That of the processes of this run, which a fixture gives; None for a single one."""


def once_a_run(name: str, make: Callable[[], bytes]) -> bytes:
    """What ``make`` gives, made by the process that asks for ``name`` first."""
    if folder is None:
        return make()
    made = folder / name
    with FileLock(f"{made}.lock"):
        if not made.exists():
            made.write_bytes(make())
        return made.read_bytes()
