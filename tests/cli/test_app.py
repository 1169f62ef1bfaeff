import errno
import os
import shutil
import signal
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
    explain,
    fast_precision,
    origin,
    quiet_if_explained,
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
    assert explain(OSError(errno.EACCES, "permission denied")) is None
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
        (TrainingInterrupted("stopped and saved", signal.SIGTERM), 143, "stopped and saved"),
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


def test_sigterm_ends_a_command_wherever_it_is(folders, monkeypatch, capsys):
    cleaned_up = []
    before = signal.getsignal(signal.SIGTERM)

    def task(config):
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            cleaned_up.append(True)

    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}"])
    with pytest.raises(SystemExit) as stop:
        run("index", task)
    assert stop.value.code == 143
    assert capsys.readouterr().err == "terminated\n"
    assert cleaned_up
    assert signal.getsignal(signal.SIGTERM) == before


def test_the_next_job_hears_signals_though_a_training_kept_them(folders, monkeypatch):
    """Lightning gives a handler back after an error that was that of the training."""
    before = signal.getsignal(signal.SIGINT)

    def task(config):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    monkeypatch.setattr("sys.argv", ["sips-index", "data=folder", "data.path=x", f"hydra.run.dir={folders}"])
    run("index", task)
    assert signal.getsignal(signal.SIGINT) == before
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_process_of_a_training_hands_sigterm_to_the_one_that_launched_it(folders, monkeypatch):
    sent = []
    monkeypatch.setattr("os.kill", lambda pid, number: sent.append((pid, number)))
    options = "data=folder", "data.path=x", f"hydra.run.dir={folders}", "hydra.job.name=train_ddp_process_1"
    monkeypatch.setattr("sys.argv", ["sips-index", *options])
    run("index", lambda config: signal.raise_signal(signal.SIGTERM))
    assert sent == [(os.getppid(), signal.SIGTERM)]


@pytest.mark.parametrize(("error", "told"), [(OSError(errno.ENOSPC, "full"), False), (OSError(5, "broken"), True)])
def test_a_thread_on_a_full_disk_leaves_the_sentence_to_the_main_thread(monkeypatch, error, told):
    shown = []
    monkeypatch.setattr("threading.__excepthook__", shown.append)
    quiet_if_explained(threading.ExceptHookArgs((type(error), error, None, None)))
    assert bool(shown) is told


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
