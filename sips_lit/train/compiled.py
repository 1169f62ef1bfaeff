"""A score network that is compiled while it trains (``torch.compile``)."""

from __future__ import annotations

import os
import shutil
from typing import Final

import torch

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.errors import BadInputError

COMPILERS: Final = ("g++", "clang++", "c++")


def compile_layers(network: ScoreNetwork) -> None:
    """Compiles what costs a network its time, `ScoreNetwork.valid`, where it is called first; the names of weights stay.

    Only the function is replaced: a wrapped module would put ``_orig_mod`` into the names in checkpoints. Logits and
    gradients are equal up to rounding. Raises BadInputError without a C++ compiler, which Inductor needs.
    """
    if shutil.which(os.environ.get("CXX", "")) is None and not any(map(shutil.which, COMPILERS)):
        raise BadInputError(
            f"module.compiled=true needs a C++ compiler ({', '.join(COMPILERS)}, or its path in CXX), and there is none: "
            "install one, or leave module.compiled=false"
        )
    vars(network)["valid"] = torch.compile(network.valid)
