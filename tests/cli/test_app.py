import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue

from sips_lit.cli.app import (
    CONF_DIR,
    errors_explained,
    explain,
    fast_precision,
    run,
    typed,
)
from sips_lit.errors import BadInputError, TrainingInterrupted


def wrapped(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


def test_the_configurations_are_found():
    assert (CONF_DIR / "train.yaml").is_file()


def test_errors_of_the_user_become_their_message():
    assert explain(BadInputError("give more frames")) == "give more frames"
    assert explain(TrainingInterrupted("stopped at step 3")) == "stopped at step 3"
    assert explain(wrapped(RuntimeError("deep"), wrapped(ValueError("deeper"), BadInputError("here")))) == "here"


def test_defects_of_the_program_are_not_explained_away():
    assert explain(ValueError("shape mismatch")) is None
    assert explain(OSError("not of the system")) is None
    assert explain(RuntimeError("the DataLoader is odd")) is None


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_named(number):
    sentence = explain(OSError(number, "No space left on device", "/data/last.ckpt"))
    assert sentence.startswith("cannot write /data/last.ckpt: the disk / is full (No space left on device): free")


def test_a_full_disk_is_found_where_the_error_names_no_file(tmp_path, full_disk):
    def sentence(free: int) -> str:
        (full_disk / "others").write_bytes(bytes(shutil.disk_usage(full_disk).free - free))
        paths = {"run": str(full_disk / "run" / "not yet"), "outputs": str(tmp_path), "frames": None}
        return explain(OSError(errno.ENOSPC, "No space left on device"), OmegaConf.create({"paths": paths}))

    assert sentence(0) == f"the disk {full_disk} is full: free some space on it, or write elsewhere (hydra.run.dir=...)"
    (full_disk / "others").unlink()
    assert "the disk of the outputs is full" in sentence(1_500_000)
    assert "hydra.run.dir" in explain(OSError(errno.ENOSPC, "No space left on device"))


@pytest.mark.parametrize(
    "code", [errno.EACCES, errno.EROFS, errno.ENOTDIR, errno.EIO, errno.ENAMETOOLONG, errno.EMFILE, errno.ESTALE]
)
@pytest.mark.parametrize("name", ["/data/run", b"/data/run", None])
def test_what_the_system_refuses_is_said_with_its_file(code, name):
    error = OSError(code, os.strerror(code), name)
    for raised in (error, wrapped(ValueError("you tried to log nan"), error)):
        assert explain(raised).startswith(f"{'/data/run: ' if name else ''}{os.strerror(code)}: ")


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


@pytest.fixture
def sigterm():
    """Its handler is given back; a signal that nobody handles would end the tests."""
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGTERM, before)


def test_sigterm_ends_a_command_and_another_does_not_disturb_the_cleaning_up(sigterm):
    cleaned = []

    def command():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            cleaned.append("all")

    with pytest.raises(SystemExit) as stop, errors_explained():
        command()
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.value.code == 143
    assert cleaned == ["all"]


def test_sigterm_after_a_stopped_training_does_not_disturb_the_end(sigterm):
    with pytest.raises(SystemExit) as stop, errors_explained():
        raise TrainingInterrupted("stopped at step 3", signal.SIGTERM)
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.value.code == 143


def test_a_command_gives_sigterm_back(sigterm):
    with errors_explained():
        assert signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize(("error", "printed"), [(OSError("full"), False), (ValueError("a defect"), True)])
def test_a_thread_that_cannot_write_prints_no_traceback(monkeypatch, capsys, error, printed):
    def fail():
        raise error

    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    with errors_explained():
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
    assert ("Traceback" in capsys.readouterr().err) == printed


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


@pytest.mark.parametrize("given", [["detect", "--help"], ["train", "--cfg", "job"]])
def test_a_reader_that_has_seen_enough_is_no_error(given):
    name, *arguments = given
    child = subprocess.Popen(
        [sys.executable, "-c", f"from sips_lit.cli.{name} import main; main()", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    child.stdout.close()
    assert child.stderr.read() == b""
    assert child.wait() == 128 + signal.SIGPIPE


@pytest.mark.skipif(torch.cuda.is_available(), reason="a GPU decides, not the processor")
@pytest.mark.parametrize(
    ("flags", "precision"),
    [("flags : avx512f amx_bf16 amx_tile", "bf16-mixed"), ("flags : avx512f avx512_bf16", "32-true"), ("", "32-true")],
)
def test_half_precision_only_on_processors_that_are_faster_with_it(flags, precision, monkeypatch):
    monkeypatch.setattr("sips_lit.cli.app.cpu_flags", lambda: flags)
    assert fast_precision() == precision
