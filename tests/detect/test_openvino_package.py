import subprocess
import sys
from importlib.util import find_spec

import pytest

from sips_lit.detect.openvino_package import openvino_core

if find_spec("openvino") is None:
    pytest.skip("needs the extra runtimes", allow_module_level=True)


def test_the_core_is_one_and_outlives_its_users():
    """Cores that came and went overwrote memory: forked workers gave images with rows of zeros, or the process died."""
    assert openvino_core("a test") is openvino_core("another one")


SCRIPT = """
import io, logging.config, sys
sys.stderr = io.StringIO()  # as while a command copies what it says into its log
from sips_lit.detect.openvino_package import import_openvino
import_openvino("a test")
taken, sys.stderr = sys.stderr, sys.__stderr__
logging.config.dictConfig({"version": 1})  # as Hydra does for each job of a sweep
print(taken.closed)
"""


def test_logging_that_is_set_up_anew_leaves_the_streams_of_its_time_open():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n", done.stderr
