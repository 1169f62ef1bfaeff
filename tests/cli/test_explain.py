import errno
import os
import shutil
import threading

import pytest
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sips_lit.cli.explain import explain, explained
from sips_lit.errors import BadInputError, TrainingInterrupted


def wrapped(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


def test_errors_of_the_user_become_their_message():
    assert explain(BadInputError("give more frames")) == "give more frames"
    assert explain(TrainingInterrupted("stopped at step 3")) == "stopped at step 3"
    assert explain(wrapped(RuntimeError("deep"), wrapped(ValueError("deeper"), BadInputError("here")))) == "here"


def test_defects_of_the_program_are_not_explained_away():
    assert explain(ValueError("shape mismatch")) is None
    assert explain(OSError("not of the system")) is None
    assert explain(RuntimeError("the DataLoader is odd")) is None


def sentence_of(**node: object) -> str | None:
    with pytest.raises(InstantiationException) as caught:
        instantiate(OmegaConf.create({"part": node}), _convert_="all")
    return explain(caught.value)


def test_what_lightning_has_against_a_job_of_slurm_is_said(monkeypatch):
    monkeypatch.setenv("SLURM_NTASKS", "2")
    monkeypatch.setenv("SLURM_JOB_NAME", "training")
    sentence = sentence_of(_target_="lightning.Trainer", accelerator="cpu", logger=False)
    assert sentence.startswith("part can't be made: You set `--ntasks=2` in your SLURM bash script")


def test_what_a_constructor_can_not_take_is_said_and_a_defect_of_one_is_not():
    told = sentence_of(_target_="lightning.Trainer", accelerator="cpu", max_time=[1, 2])
    assert told == "part can't be made: 'list' object has no attribute 'total_seconds'"
    assert sentence_of(_target_="fractions.Fraction", denominator="x", numerator=1).startswith("part can't be made: ")
    assert sentence_of(_target_="asyncio.get_running_loop") is None


def test_a_target_that_is_not_there_is_said():
    told = sentence_of(_target_="my_package.Loader")
    assert told == "part._target_ is my_package.Loader, which can't be imported: No module named 'my_package'"
    assert sentence_of(_target_="sips_lit.types.Nothing").startswith("part._target_ is sips_lit.types.Nothing, which")
    assert sentence_of(_target_="").startswith("part._target_ is , which can't be imported: ")
    assert sentence_of(_target_=-1).startswith("part._target_ is no class or function: Expected a callable target, got")


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


@pytest.mark.parametrize(("error", "printed"), [(OSError("full"), False), (ValueError("a defect"), True)])
def test_a_thread_that_cannot_write_prints_no_traceback(monkeypatch, capsys, error, printed):
    def fail():
        raise error

    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    with explained():
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
    assert ("Traceback" in capsys.readouterr().err) == printed
