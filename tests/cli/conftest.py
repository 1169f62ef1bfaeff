"""Runs commands as a user does: arguments in, exit code and text out, in this process (fast) or in one of its own."""

import importlib
import logging
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import pytest
import torch
from cli_runs import Command, Result, write_frames
from forked_commands import ForkedCommand
from hydra.core.hydra_config import HydraConfig
from textured_scenes import flight

from sips_lit.detect.checkpoint import export_safetensors
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector


@pytest.fixture(scope="session")
def frames(tmp_path_factory) -> Path:
    """A folder of 16 images, 128 x 96."""
    return write_frames(tmp_path_factory.mktemp("frames") / "plane", flight(16, size=(128, 96)).frames)


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory) -> Path:
    """An untrained network as an exported file."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("checkpoint") / "untrained.safetensors"
    export_safetensors(ScoreNetwork(3, 4), PointSelector(), path)
    return path


@pytest.fixture(autouse=True)
def no_drawing(request, monkeypatch) -> None:
    """Figures are made but not drawn, which takes a third of a tiny training, except in tests marked ``draws``."""
    if request.node.get_closest_marker("draws") is None:
        monkeypatch.setattr("matplotlib.figure.Figure.draw", lambda figure, renderer: None)


@pytest.fixture
def folders(tmp_path, monkeypatch) -> Path:
    """A place of its own for what commands write."""
    monkeypatch.setenv("SIPS_LIT_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("SIPS_LIT_OUTPUTS", str(tmp_path / "outputs"))
    return tmp_path


@pytest.fixture
def command(folders, monkeypatch, capsys) -> Command:
    """``command("train", "data=folder", ...)`` runs a command in this process and leaves no trace in it."""
    root, threads = logging.getLogger(), cv2.getNumThreads()
    handlers, level = root.handlers[:], root.level
    monkeypatch.setenv("HYDRA_FULL_ERROR", "")
    monkeypatch.delenv("HYDRA_FULL_ERROR")
    # Hydra composes all of it once more, only to look for a hydra.mode, which ours do not set
    monkeypatch.setattr("hydra._internal.hydra.Hydra.get_mode", lambda *_, **__: None)
    monkeypatch.setattr(sys, "gettrace", lambda: None)  # Hydra takes the tracing of coverage for a debugger

    def run(name: str, *arguments: str) -> Result:
        main = importlib.import_module(f"sips_lit.cli.{name}").main
        monkeypatch.setattr(sys, "argv", [f"sips-{name}", *map(str, arguments)])
        capsys.readouterr()
        code = 0
        with warnings.catch_warnings():
            try:
                main()
            except SystemExit as stop:
                code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        text = capsys.readouterr()
        return Result(code, text.out, text.err)

    yield run
    HydraConfig.instance().cfg = None  # else what runs later in this process takes itself for a job of a sweep
    cv2.setNumThreads(threads)
    root.handlers[:], root.level = handlers, level
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def process(folders) -> Iterator[Callable[..., ForkedCommand]]:
    """``process("train", "data=folder", ...)`` starts a command in a process group of its own; ends it with the test."""
    started: list[ForkedCommand] = []

    def start(name: str, *arguments: str, ranks: int = 0) -> ForkedCommand:
        log = folders / f"process{len(started)}.log"
        started.append(ForkedCommand(folders, log, name, *arguments, ranks=ranks))
        return started[-1]

    yield start
    for child in started:
        child.end()
