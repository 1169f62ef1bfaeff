"""Options of a command that has plain keys: the types of its YAML, checked before anything runs."""

from __future__ import annotations

from typing import TypeVar, cast

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ValidationError

from sips_lit.errors import BadInputError

Options = TypeVar("Options")


def typed(config: DictConfig, options: type[Options]) -> Options:
    """The configuration as an instance of the dataclass ``options``, which has the same keys.

    Raises BadInputError for a value of the wrong type, MissingMandatoryValue for a key that is not set.
    """
    for key in sorted(OmegaConf.missing_keys(config)):
        OmegaConf.select(config, key, throw_on_missing=True)
    try:
        return cast(Options, OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(options), config)))
    except ValidationError as error:
        raise BadInputError(f"{error.full_key} has a value of the wrong type: {str(error).splitlines()[0]}") from error
