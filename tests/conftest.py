import copy
import functools
import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import once_a_run
import pytest
import torch
from omegaconf import OmegaConf
from own_dataset import write_package
from textured_scenes import ArraySequence, flight


@pytest.fixture(scope="session", autouse=True)
def configurations_parsed_once() -> Iterator[None]:
    """A composition reads some twenty files, again and again for each of them: two fifths of its time."""
    load, parsed = OmegaConf.load, {}

    def load_once(file):
        path = Path(getattr(file, "name", file))
        if not path.is_absolute():
            return load(file)
        state = path.stat()
        key = path, state.st_ino, state.st_size, state.st_mtime_ns
        if key not in parsed:
            parsed[key] = load(file)
        return copy.deepcopy(parsed[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OmegaConf, "load", staticmethod(load_once))
        yield


@pytest.fixture(scope="session", autouse=True)
def translators_are_not_traced() -> Iterator[None]:
    """Coverage doubles the time of these, which call thousands of functions of their own, and few of the package."""

    def untraced(function):
        @functools.wraps(function)
        def call(*arguments, **options):
            tracer = sys.gettrace()
            sys.settrace(None)
            try:
                return function(*arguments, **options)
            finally:
                sys.settrace(tracer)

        return call

    with pytest.MonkeyPatch.context() as patch:
        for module in (torch.export, torch.onnx):
            patch.setattr(module, "export", untraced(module.export))
        yield


@pytest.fixture(scope="session", autouse=True)
def modules_are_not_collected() -> None:
    """What is loaded by now stays until the end: each search of it for garbage is in vain."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """Networks this small lose time to threads, and the tests run in two processes."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def what_is_made_once(tmp_path_factory) -> None:
    """Processes of one run have their folders in the same one. By no fixture of xdist: mutants have no plugins."""
    several = "PYTEST_XDIST_WORKER" in os.environ
    once_a_run.folder = tmp_path_factory.getbasetemp().parent if several else None


@pytest.fixture(scope="session")
def short_flight() -> ArraySequence:
    """12 frames, 160 x 120, of a camera that moves and zooms over a plane: homographies are known."""
    return flight()


@pytest.fixture
def installed(tmp_path_factory, monkeypatch):
    """``installed()`` puts the package of `own_dataset` onto the path, as pip would; gone after the test."""

    def install(**options: str) -> None:
        monkeypatch.syspath_prepend(write_package(tmp_path_factory.mktemp("site-packages"), **options))

    yield install
    for name in [name for name in sys.modules if name.split(".")[0] == "walks"]:
        del sys.modules[name]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real sequences, for tests marked ``shared_data``."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no real sequences in ../shared/data beside the repository")
    return folder


@pytest.fixture(scope="session")
def shared_cases(shared_data: Path) -> Path:
    """Folder of small awkward inputs, for tests marked ``shared_data``."""
    return shared_data.parent / "cases"


@pytest.fixture
def full_disk(tmp_path) -> Iterator[Path]:
    """A disk of its own of 2 MB, where the machine lets us mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("a disk can't be mounted here")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)
