import platform
from pathlib import Path

from sips_lit.report.machine import describe_machine


def test_it_does_not_tell_whose_machine_it_is():
    machine = describe_machine()
    assert int(machine["cores"]) >= 1
    assert machine["processor"]
    text = " ".join(machine.values())
    assert str(Path.home()) not in text
    assert not platform.node() or platform.node() not in text.split()
