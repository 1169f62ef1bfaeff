import os
import signal
import subprocess
import sys

import pytest

from sips_lit.cli.explain import explained
from sips_lit.errors import TrainingInterrupted


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

    with pytest.raises(SystemExit) as stop, explained():
        command()
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.value.code == 143
    assert cleaned == ["all"]


def test_sigterm_after_a_stopped_training_does_not_disturb_the_end(sigterm):
    with pytest.raises(SystemExit) as stop, explained():
        raise TrainingInterrupted("stopped at step 3", signal.SIGTERM)
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.value.code == 143


def test_a_command_gives_sigterm_back(sigterm):
    with explained():
        assert signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize("given", [["detect", "--help"], ["train", "--cfg", "job"]])
def test_a_reader_that_has_seen_enough_is_no_error(given):
    name, *arguments = given
    child = subprocess.Popen(
        [sys.executable, "-c", f"from sips_lit.cli.start import {name}; {name}()", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    child.stdout.close()
    assert child.stderr.read() == b""
    assert child.wait() == 128 + signal.SIGPIPE
