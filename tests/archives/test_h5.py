import multiprocessing
import os
import pickle
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from sips_lit.archives import h5
from sips_lit.archives.h5 import H5File
from sips_lit.errors import BadInputError

h5py = pytest.importorskip("h5py", reason="h5py is missing: pip install 'sips_lit[baselines]'")
POINTS = np.arange(10, dtype=np.float16).reshape(5, 2)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in ("a/1.png", "a/2.png"):
            file.create_group(name)["points"] = POINTS
        file["a/1.png"].create_dataset("packed", data=np.arange(1000), compression="gzip")
        file.create_group("b")["other"] = POINTS
    return tmp_path / "a.h5"


def test_groups_and_arrays(path: Path):
    file = H5File(path)
    assert file.groups_with("points") == ["a/1.png", "a/2.png"]
    held = file.read("a/1.png", ("points", "packed", "absent"))
    assert list(held) == ["points", "packed"]
    np.testing.assert_array_equal(held["points"], POINTS)
    np.testing.assert_array_equal(held["packed"], np.arange(1000))
    assert held["points"].dtype == np.float16


def test_threads_processes_and_copies(path: Path):
    file = H5File(path)
    assert file.groups_with("other") == ["b"]  # its child is there before the fork
    with ThreadPoolExecutor(4) as pool:
        for held in pool.map(lambda _: file.read("b", ("other",)), range(20)):
            np.testing.assert_array_equal(held["other"], POINTS)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(file)).read("b", ("other",))["other"], POINTS)
    with multiprocessing.get_context("fork").Pool(2) as processes:
        for held in [*processes.map(read_other, [file] * 4), file.read("b", ("other",))]:
            np.testing.assert_array_equal(held["other"], POINTS)


def read_other(file: H5File):
    return file.read("b", ("other",))


def test_a_child_that_takes_too_long_is_stopped(path: Path, monkeypatch):
    monkeypatch.setattr(h5, "SECONDS", 0.5)
    file = H5File(path)
    assert file.groups_with("other") == ["b"]
    os.kill(file._child.pid, signal.SIGSTOP)  # it does not answer, as in an endless loop
    begin = time.monotonic()
    with pytest.raises(BadInputError, match=r"a\.h5 can't be read as h5: it is damaged"):
        file.groups_with("other")
    assert 0.4 < time.monotonic() - begin < 5
    assert file.groups_with("other") == ["b"]  # by another child


def test_a_child_that_crashed_is_replaced(path: Path):
    file = H5File(path)
    assert file.groups_with("other") == ["b"]
    file._child.kill()
    with pytest.raises(BadInputError, match="can't be read as h5"):
        file.groups_with("other")
    assert file.groups_with("other") == ["b"]


def test_the_child_ends_with_the_file(path: Path):
    file = H5File(path)
    file.groups_with("other")
    child = file._child
    del file
    assert child.poll() is not None


def test_the_child_can_not_take_all_memory(path: Path, monkeypatch):
    """It has three times the largest answer."""
    monkeypatch.setattr(h5, "SECONDS", 100.0)
    with h5py.File(path, "a") as file:
        file["b"].create_dataset("full", (h5.LARGEST,), np.uint8, chunks=(2**20,), compression="gzip", fillvalue=7)
        file["b"].create_dataset("more", (h5.LARGEST + 1,), np.uint8, chunks=(2**20,))
        file["b"].create_dataset("chunk", (100,), np.uint8, chunks=(2**31,), maxshape=(None,))
    read = H5File(path)
    full = read.read("b", ("full",))["full"]
    assert len(full) == h5.LARGEST
    assert (full[::1000] == 7).all()
    for name in (("more",), ("chunk",), ("full", "other")):
        with pytest.raises(BadInputError, match="can't be read as h5"):
            read.read("b", name)
    assert read._child.poll() is None


def test_only_plain_arrays_of_the_file_itself(path: Path, tmp_path: Path):
    secret = tmp_path / "secret"
    secret.write_bytes(b"0123456789")
    with h5py.File(path, "a") as file:
        file["b/link"] = h5py.ExternalLink("other.h5", "/b/other")
        file["b/soft"] = h5py.SoftLink("/a/1.png/points")
        file["b"].create_dataset("external", (10,), np.uint8, external=[(str(secret), 0, 10)])
        file["b"].create_virtual_dataset("virtual", h5py.VirtualLayout((5, 2), np.float16))
        file["b/text"] = "a sentence"
        file["b"].create_dataset("objects", (2,), h5py.ref_dtype)
    for name in ("link", "soft", "external", "virtual", "text", "objects"):
        with pytest.raises(BadInputError, match="can't be read as h5"):
            H5File(path).read("b", (name,))


def test_what_is_no_h5(tmp_path: Path, monkeypatch):
    (tmp_path / "a.h5").write_bytes(b"nonsense")
    with pytest.raises(BadInputError, match="can't be read as h5"):
        H5File(tmp_path / "a.h5").groups_with("points")
    monkeypatch.setattr(h5.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BadInputError, match=r"needs the package h5py: pip install 'sips_lit\[baselines\]'"):
        H5File(tmp_path / "a.h5")


def test_no_module_of_the_current_folder_is_loaded(path: Path, monkeypatch):
    (path.parent / "h5py.py").write_text("raise SystemExit")
    monkeypatch.chdir(path.parent)
    monkeypatch.setattr(os, "environ", {**os.environ})
    assert H5File(path).groups_with("other") == ["b"]
