import json
import pickle
import sys

import pytest

from sips_lit.errors import BadInputError, InputWarning, TrainingInterrupted, import_extra, warn_input


@pytest.mark.parametrize("kind", [BadInputError, TrainingInterrupted])
def test_errors_reach_the_main_process_whole(kind):
    """Workers send what they raise by pickle."""
    error = pickle.loads(pickle.dumps(kind("left.png cannot be read: replace it")))
    assert type(error) is kind
    assert str(error) == "left.png cannot be read: replace it"


def test_bad_input_is_a_value_error():
    """Callers who do not know the package catch what Python itself raises for a bad value."""
    with pytest.raises(ValueError, match=r"^ks is empty$"):
        raise BadInputError("ks is empty")


def test_an_interruption_is_nothing_that_code_recovers_from():
    """A method that fails is skipped and the next one measured, but Ctrl-C has to end the command."""
    assert not issubclass(TrainingInterrupted, ValueError)
    assert not issubclass(BadInputError, TrainingInterrupted)


def test_a_missing_package_is_named_with_the_extra_that_has_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "kornia.feature", None)
    with pytest.raises(BadInputError, match=r"^Some needs the package kornia: pip install 'sips_lit\[baselines\]'$"):
        import_extra("kornia.feature", "baselines", "Some")
    assert import_extra("json", "test", "Some") is json


def test_what_is_quoted_from_a_file_stays_on_the_line():
    error = BadInputError("a\x1b[2J\n\0é/" + "9" * 5000 + " is no number")
    assert str(error) == r"a\x1b[2J\n\x00é/" + "9" * (500 - len(r"a\x1b[2J\n\x00é/")) + "... is no number"
    path = "/" + "/".join(["folder"] * 100)
    assert str(BadInputError(f"there is no {path}")) == f"there is no {path}"
    with pytest.warns(InputWarning, match=r"two\\nlines"):
        warn_input("two\nlines")


def test_an_interruption_knows_its_signal():
    stopped = pickle.loads(pickle.dumps(TrainingInterrupted("stopped at step 3", 15)))
    assert (str(stopped), stopped.number) == ("stopped at step 3", 15)
    assert TrainingInterrupted("stopped").number == 2
