"""Commands in processes of their own, forked from one that has loaded them: each starts in a moment."""

import importlib
import multiprocessing
import os
import runpy
import signal
import sys
from pathlib import Path

import pytest
from cli_runs import ROOT
from forked_ranks import ranks_ready

SCRIPT = "import sys\nfrom sips_lit.cli.{name} import main\nsys.exit(main())\n"  # as pip installs it
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["forked_commands", "sips_lit.cli.train"])


class ForkedCommand(CONTEXT.Process):  # type: ignore[name-defined, misc]
    """``sips-<name>`` in a process group of its own, started in a folder; what it prints is in the file ``log``.

    ``name`` may also be the path of a script. ``ranks``: how many processes Lightning will launch beside it, which are then
    forked, too; with 0 they start as a user's do.
    """

    def __init__(self, folder: Path, log: Path, name: str, *arguments: object, ranks: int = 0) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"}
        self.log, script = log, Path(name)
        if script.suffix != ".py":
            script = folder / f"sips-{name}"
            script.write_text(SCRIPT.format(name=name))
        log.touch()
        arguments = folder, log, environment, ranks, name, [str(script), *map(str, arguments)]
        super().__init__(target=run, args=arguments)
        with pytest.MonkeyPatch.context() as patch:  # what the server finds when it starts
            patch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(Path(__file__).parent)]))
            patch.setenv("OMP_NUM_THREADS", "1")
            self.start()

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        return self.exitcode

    def wait(self, timeout: float) -> int:
        """The exit code of the command, which must end in time."""
        self.join(timeout)
        assert self.exitcode is not None, self.log.read_text()
        return self.exitcode

    def end(self) -> None:
        """Kills what still runs of it."""
        if self.exitcode is None:
            os.killpg(self.pid, signal.SIGKILL)
        self.join()


def run(folder: Path, log: Path, environment: dict[str, str], ranks: int, name: str, argv: list[str]) -> None:
    # loading workers as a user's: this process has the server's way of starting others, and they would not be its children
    multiprocessing.set_start_method(multiprocessing.get_all_start_methods()[0], force=True)
    os.setsid()
    os.chdir(folder)
    os.environ.update(environment)
    with log.open("a") as handle:
        os.dup2(handle.fileno(), 1)
        os.dup2(handle.fileno(), 2)
    sys.path.insert(0, str(folder))  # that of the script, as Python has it
    sys.argv = argv
    if name.endswith(".py"):
        runpy.run_path(name, run_name="__main__")
        return
    main = importlib.import_module(f"sips_lit.cli.{name}").main
    with ranks_ready(ranks, main):
        main()
