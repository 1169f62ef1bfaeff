import json
import subprocess
import sys

import pytest

from sips_lit.cli import start
from sips_lit.cli.conf_files import CONF_DIR

SCRIPT = """
import json, sys
from sips_lit.cli.start import {name} as main
sys.argv = ["sips-{name}", *{arguments!r}]
try:
    main()
finally:
    print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("arguments", "shown", "unloaded"),
    [
        (["--help"], "sips-detect input=", {"torch", "cv2", "numpy", "hydra", "omegaconf"}),
        (["--cfg", "job"], "checkpoint: sips-tiny", {"torch", "cv2"}),
        (["--hydra-help"], "Hydra", {"torch", "cv2"}),
    ],
)
def test_what_only_asks_loads_nothing_slow(arguments, shown, unloaded):
    code = SCRIPT.format(name="detect", arguments=arguments)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert shown in run.stdout
    assert not unloaded & set(json.loads(run.stderr.splitlines()[-1]))


def test_a_run_is_handed_to_the_command(monkeypatch):
    ran = []
    monkeypatch.setattr("sips_lit.cli.export.main", lambda: ran.append(sys.argv[1:]))
    monkeypatch.setattr(sys, "argv", ["sips-export", "checkpoint=a.ckpt"])
    start.export()
    assert ran == [["checkpoint=a.ckpt"]]


def test_there_is_a_start_for_every_command_with_a_configuration():
    for path in CONF_DIR.glob("*.yaml"):
        assert getattr(start, path.stem).args == (path.stem,)
