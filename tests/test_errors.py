import pickle

import pytest

from sips_lit.errors import BadInputError, TrainingInterrupted


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


def test_an_interruption_knows_its_signal():
    stopped = pickle.loads(pickle.dumps(TrainingInterrupted("stopped at step 3", 15)))
    assert (str(stopped), stopped.number) == ("stopped at step 3", 15)
    assert TrainingInterrupted("stopped").number == 2
