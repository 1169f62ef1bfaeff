"""HDF5 files of strangers. A damaged one can make HDF5's C library loop, crash or ask for any amount of memory, and nothing
within its process can stop it: a child process reads them, with limits of time and memory.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import os
import pickle
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.archives.zip_members import LARGEST
from sips_lit.errors import BadInputError

SECONDS = 10.0  # for an answer, and more for large files:
BYTES_A_SECOND = 20e6  # to list the groups of a file takes longer, the more there are
READY = b"!"  # what the child says when it has loaded its libraries
MEMORY = 3 * LARGEST  # bytes that the child may use


class H5File:
    """Groups of arrays in an HDF5 file. Threads may share it, and it pickles; the child lives as long as this does."""

    def __init__(self, path: Path) -> None:
        """Raises BadInputError where h5py is missing."""
        if importlib.util.find_spec("h5py") is None:
            raise BadInputError(f"{path} needs the package h5py: pip install 'sips_lit[baselines]'")
        self.path, self._seconds = path, SECONDS + path.stat().st_size / BYTES_A_SECOND
        self._child: subprocess.Popen[bytes] | None = None
        self._owner = 0  # the process that started it: one that is forked from this process needs another
        self._lock = threading.Lock()

    def groups_with(self, name: str) -> list[str]:
        """The paths of the groups that hold something called ``name``. Raises BadInputError as `read` does."""
        found: list[str] = self._ask("groups", name)
        return found

    def read(self, group: str, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Those arrays of numbers of a group that it has, by name.

        Raises BadInputError where the file can't be read in time, or an array is no plain one: of other values than numbers,
        too large, or kept in another file.
        """
        held: dict[str, NDArray[Any]] = self._ask("arrays", group, tuple(names))
        return held

    def _ask(self, *request: Any) -> Any:
        with self._lock:
            child = self._child if self._child and self._owner == os.getpid() else self._start()
            assert child.stdin
            assert child.stdout
            limit = threading.Timer(self._seconds, child.kill)
            limit.start()
            try:
                pickle.dump(request, child.stdin)
                child.stdin.flush()
                reply = pickle.load(child.stdout)
            except (OSError, EOFError, pickle.UnpicklingError):  # it crashed or was stopped
                child.kill()
                self._child, reply = None, None
            finally:
                limit.cancel()
        if reply is None:
            raise BadInputError(f"{self.path} can't be read as h5: it is damaged, or of another kind")
        return reply

    def _start(self) -> subprocess.Popen[bytes]:
        # -P: no module is loaded from the current folder; the last variable: no filter is loaded from the system's folders
        paths = [str(Path(__file__).parents[2]), *filter(None, sys.path)]
        environment = {"PYTHONPATH": os.pathsep.join(paths), "HDF5_PLUGIN_PRELOAD": "::"}
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, str(self.path)],
            env=os.environ | environment | {"OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._child.stdout
        self._child.stdout.read(len(READY))  # on a busy machine that takes seconds, which are not those of the file
        self._owner = os.getpid()
        weakref.finalize(self, _stop, self._child, self._owner)
        return self._child

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["path"])  # type: ignore[misc]  # of this class, or of one below it that has no more arguments


def _stop(child: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() == owner:
        child.kill()
        child.communicate()


def _serve(path: str, requests: IO[bytes], replies: IO[bytes]) -> None:
    """What the child does: answers requests until their end; None where the file can't be read."""
    h5py = importlib.import_module("h5py")

    _limit_memory(MEMORY)
    replies.write(READY)
    replies.flush()
    file: Any = None
    reply: Any = None
    while True:
        try:
            kind, *arguments = pickle.load(requests)
        except EOFError:
            return
        try:
            file = file or h5py.File(path, "r")
            reply = _groups_with(file, *arguments) if kind == "groups" else _arrays(file, *arguments)
        except Exception:  # damaged bytes make h5py raise almost anything
            reply = None
        pickle.dump(reply, replies)
        replies.flush()


def _limit_memory(more: int) -> None:
    """Lets this process have so many bytes more, on systems that can tell what it has (Linux)."""
    if Path("/proc/self/statm").is_file():
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more,) * 2)


def _groups_with(file: Any, wanted: str) -> list[str]:
    names: list[str] = []
    file.visit(names.append)
    return [str(name.parent) for name in map(PurePosixPath, names) if name.name == wanted]


def _arrays(file: Any, group: str, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    h5py = importlib.import_module("h5py")

    held, parent = {}, file[group]
    links = {name: parent.get(name, getlink=True) for name in names}
    for name in (name for name, link in links.items() if link is not None):
        array = parent[name] if isinstance(links[name], h5py.HardLink) else None
        if not isinstance(array, h5py.Dataset) or array.is_virtual or array.external:
            raise ValueError(f"{name} is no plain array")
        # a chunk is read whole, whatever the array needs of it
        count = max(math.prod(array.shape), math.prod(array.chunks or ()))
        if array.dtype.kind not in "biuf" or count * array.dtype.itemsize > LARGEST:
            raise ValueError(f"{name} is no array of numbers, or too large")
        held[name] = array
    if sum(array.size * array.dtype.itemsize for array in held.values()) > LARGEST:
        raise ValueError("too large together")
    return {name: np.asarray(array) for name, array in held.items()}


if __name__ == "__main__":
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not come between the replies
    _serve(sys.argv[1], sys.stdin.buffer, out)
