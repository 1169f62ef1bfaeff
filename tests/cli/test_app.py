import errno
import os
import threading
from dataclasses import dataclass
from typing import Any

import pytest
from hydra.errors import InstantiationException
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sips_lit.cli.app import (
    CONF_DIR,
    build,
    errors_explained,
    explain,
    fast_precision,
    origin,
    register_resolvers,
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


def test_a_full_disk_names_the_file():
    assert "the disk is full" in explain(OSError(errno.ENOSPC, "No space left on device", "/data/last.ckpt"))
    assert "/data/last.ckpt" in explain(OSError(errno.ENOSPC, "No space left on device", "/data/last.ckpt"))
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


@pytest.mark.parametrize(("error", "told"), [(OSError(errno.ENOSPC, "No space"), False), (ZeroDivisionError(), True)])
def test_a_thread_that_cannot_write_prints_no_traceback(error, told, capsys):
    def fail():
        raise error

    with errors_explained():
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
    assert ("Traceback" in capsys.readouterr().err) == told


@pytest.mark.parametrize(
    "text",
    [
        "DataLoader worker (pid 4711) is killed by signal: Killed. ",
        "DataLoader worker (pid(s) 1, 2) exited unexpectedly",
    ],
)
def test_a_killed_worker(text):
    assert "loading_workers" in explain(RuntimeError(text))


def missing(config: dict, key: str) -> str:
    """What is said of a value that is not set when it is used as ``key``."""
    node = OmegaConf.create(config)
    with pytest.raises(OmegaConfBaseException) as caught:
        OmegaConf.select(node, key, throw_on_missing=True)
    return explain(caught.value, node)


def test_a_missing_key_is_named_as_the_user_sets_it():
    assert missing({"checkpoint": "???"}, "checkpoint") == "checkpoint is not set: add checkpoint=... to the command"
    nested = {"data": {"path": "???"}, "datamodule": {"data": "${data}"}}
    assert missing(nested, "data.path").startswith("data.path is not set")
    assert missing(nested, "datamodule.data.path").startswith("data.path is not set: add data.path=...")
    used = {"checkpoint": "???", "detector": {"path": "${checkpoint}"}}
    assert missing(used, "detector.path").startswith("checkpoint is not set")


def test_a_missing_value_inside_of_a_part():
    config = OmegaConf.create({"a": "???", "part": {"_target_": "builtins.dict", "x": "${a}"}})
    with pytest.raises(OmegaConfBaseException) as caught:
        build(config.part)
    assert explain(caught.value, config).startswith("a is not set")


def test_where_a_value_comes_from():
    config = OmegaConf.create({"a": {"b": 1}, "c": "${a}", "d": {"e": "${c.b}", "f": "x ${a.b}", "g": [1]}})
    for key, expected in (("a.b", "a.b"), ("c.b", "a.b"), ("d.e", "a.b"), ("d.f", "d.f"), ("d.g.0", "d.g.0")):
        assert origin(key, config) == expected
    assert origin("no.such.key", config) == "no.such.key"
    assert origin("c.b", None) == "c.b"


def test_values_that_a_constructor_refuses():
    config = OmegaConf.create({"model": {"_target_": "sips_lit.detect.score_network.ScoreNetwork", "width": 3}})
    with pytest.raises(InstantiationException) as caught:
        build(config.model)
    assert explain(caught.value).startswith("model can't be made: a score network needs")
    # a defect inside of a constructor is not the user's
    broken = OmegaConf.create({"model": {"_target_": "operator.truediv", "_args_": [1, 0]}})
    with pytest.raises(InstantiationException) as caught:
        build(broken.model)
    assert explain(caught.value) is None


def test_build_passes_plain_containers_and_extras():
    node = OmegaConf.create({"_target_": "builtins.dict", "a": [1, {"b": 2}]})
    built = build(node, c=3)
    assert built == {"a": [1, {"b": 2}], "c": 3}
    assert type(built["a"]) is list
    assert type(built["a"][1]) is dict


@pytest.mark.parametrize(("flags", "expected"), [("flags: avx512_bf16", "bf16-mixed"), ("flags: sse2", "32-true")])
def test_bf16_only_where_it_is_fast(monkeypatch, flags, expected):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("torch.backends.cpu.get_cpu_capability", lambda: "AVX512")
    monkeypatch.setattr("sips_lit.cli.app.cpu_flags", lambda: flags)
    assert fast_precision() == expected
    register_resolvers()
    assert OmegaConf.create({"p": "${fast_precision:}"}).p == expected


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (BadInputError("no frames: give some"), 1, "error: no frames: give some"),
        (TrainingInterrupted("stopped and saved"), 130, "stopped and saved"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_how_a_command_ends(folders, monkeypatch, capsys, error, code, text):
    def task(config):
        raise error

    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}"])
    with pytest.raises(SystemExit) as stop:
        run("index", task)
    assert stop.value.code == code
    shown = capsys.readouterr().err
    assert text in shown
    assert "Traceback" not in shown


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
