"""OpenVINO, imported so that it leaves the process in order."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from sips_lit.detect.onnx_graph import EXTRA
from sips_lit.errors import import_extra


def import_openvino(needed_by: str) -> Any:
    """The package. Raises BadInputError where it is not installed; ``needed_by`` says who needs it.

    Its import loads absl, whose log handler keeps what standard error is at that moment and closes it when logging is set
    up anew, as it is for each job of a sweep. The handler gets the process's own stream, which it leaves open.
    """
    openvino = import_extra("openvino", EXTRA, needed_by)
    absl = sys.modules.get("absl.logging")
    if absl is not None:
        absl.get_absl_handler().python_handler.stream = sys.__stderr__
    return openvino


def openvino_core(needed_by: str) -> Any:
    """OpenVINO's core. Raises BadInputError as `import_openvino` does.

    There is one in a process and it never ends: with cores that came and went, memory of others was overwritten.
    """
    return _only_core(import_openvino(needed_by).Core)


@lru_cache(1)
def _only_core(make: Callable[[], Any]) -> Any:
    return make()
