from dataclasses import dataclass
from typing import Any

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue

from sips_lit.cli.options import typed
from sips_lit.errors import BadInputError


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
