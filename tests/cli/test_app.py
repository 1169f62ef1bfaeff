import os
import re
from dataclasses import dataclass
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue

from sips_lit.cli.app import build, fast_precision, run, typed
from sips_lit.errors import BadInputError


def test_a_run_folder_that_cannot_be_made(folders, monkeypatch, capsys):
    (folders / "file").write_text("")
    monkeypatch.setenv("HYDRA_FULL_ERROR", "")
    monkeypatch.delenv("HYDRA_FULL_ERROR")
    monkeypatch.setattr("sys.gettrace", lambda: None)
    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}/file/run"])
    with pytest.raises(SystemExit) as stop:
        run("index", lambda config: None)
    assert stop.value.code == 1
    assert capsys.readouterr().err.startswith(f"error: {folders}/file/run: Not a directory: ")
    assert "HYDRA_FULL_ERROR" not in os.environ


def test_an_interrupted_fit_ends_as_interrupted(folders, monkeypatch):
    def task(config):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise SystemExit(1)  # noqa: B904 - as Lightning does it

    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}"])
    with pytest.raises(SystemExit) as stop:
        run("index", task)
    assert stop.value.code == 130


def test_a_defect_keeps_its_traceback(folders, monkeypatch, capsys):
    def task(config):
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}"])
    monkeypatch.setattr("sys.gettrace", lambda: None)  # Hydra takes the tracing of coverage for a debugger
    with pytest.raises(SystemExit) as stop:
        run("index", task)
    assert stop.value.code == 1
    assert "ZeroDivisionError: a defect" in capsys.readouterr().err


@dataclass
class Options:
    path: str
    n: int
    ratio: float
    k: int | None
    on: bool
    anything: Any


GIVEN = {"path": "x", "n": 3, "ratio": 0.5, "k": None, "on": True, "anything": ["a", {"b": 1}]}


def options(**changes: Any) -> Options:
    return typed(OmegaConf.create({**GIVEN, **changes}), Options)


def test_values_become_an_instance():
    found = options()
    assert found == Options(**GIVEN)
    assert type(found.anything) is list
    assert type(found.anything[1]) is dict


def test_numbers_are_numbers_of_their_kind():
    found = options(ratio=1, k=7, path=5)
    assert type(found.ratio) is float
    assert found.k == 7
    assert found.path == "5"


@pytest.mark.parametrize(
    ("key", "value"),
    [("n", "many"), ("n", 1.5), ("n", None), ("ratio", "half"), ("k", "x"), ("on", "perhaps"), ("path", ["a", "b"])],
)
def test_values_of_the_wrong_type(key, value):
    with pytest.raises(BadInputError) as caught:
        options(**{key: value})
    assert str(caught.value).startswith(f"{key} has a value of the wrong type: ")
    assert "\n" not in str(caught.value)


def test_the_first_missing_key_is_named():
    with pytest.raises(MissingMandatoryValue, match="n"):
        options(path="???", n="???")
    assert options().n == 3


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"a: [1", r"expected ',' or ']'.*line 1"),
        (b"\xff\xfe\x00", "can't decode byte 0xff"),
        (b"5", "int"),
        (b"defaults: 5", "defaults must be a list"),
        (b"a: {{1}}", "unhashable key"),
        (b"a: !!python/object:os.system {}", "could not determine a constructor"),
    ],
)
def test_a_file_of_the_configuration_that_can_not_be_read(command, folders, content, reason):
    (folders / "experiment").mkdir()
    (folders / "experiment" / "mine.yaml").write_bytes(content)
    result = command("index", "--config-dir", folders, "+experiment=mine", "data=folder", "data.path=x")
    assert re.search(f"a file of the configuration can't be read: .*{reason}", result.sentence)


def test_a_sweep_over_a_file_that_can_not_be_read(command, folders):
    (folders / "experiment").mkdir()
    (folders / "experiment" / "mine.yaml").write_text("a: [1")
    result = command(
        "index", "-m", "--config-dir", folders, "+experiment=mine", "data=folder", "data.path=x", "shard=1/2,2/2"
    )
    assert "a file of the configuration can't be read: " in result.sentence


def test_a_launcher_that_fails_is_told_as_one(command, frames):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="needs the extra sweep")
    launcher = "hydra/launcher=joblib", "hydra.launcher.n_jobs=0"
    result = command("index", "-m", "data=folder", f"data.path={frames}", "shard=1/2,2/2", *launcher)
    assert result.sentence.startswith("the launcher of the jobs (hydra.launcher) fails: n_jobs == 0")


@pytest.mark.skipif(torch.cuda.is_available(), reason="a GPU decides, not the processor")
@pytest.mark.parametrize(
    ("flags", "precision"),
    [("flags : avx512f amx_bf16 amx_tile", "bf16-mixed"), ("flags : avx512f avx512_bf16", "32-true"), ("", "32-true")],
)
def test_half_precision_only_on_processors_that_are_faster_with_it(flags, precision, monkeypatch):
    monkeypatch.setattr("sips_lit.cli.app.cpu_flags", lambda: flags)
    assert fast_precision() == precision


def test_a_name_where_a_configuration_belongs_is_told_of_with_what_to_write():
    assert build(None) is None
    with pytest.raises(BadInputError, match=r"the name 'klt' stands where .*- override /inliers: klt"):
        build("klt")
