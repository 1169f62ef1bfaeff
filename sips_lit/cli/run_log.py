"""The log in the folder of a run: what the terminal said, line by line, without progress bars."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, TextIO, cast

from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException


def log_file() -> Path | None:
    """The log of this run; None for a command that leaves no files of its own, and for helpers of a training."""
    hydra = HydraConfig.get()
    return None if hydra.output_subdir is None else Path(hydra.runtime.output_dir) / f"{hydra.job.name}.log"


@contextmanager
def logged(path: Path | None) -> Iterator[None]:
    """Adds what is written to standard output and error to the file at ``path``, and a traceback of what is raised."""
    if path is None:
        yield
        return
    with path.open("a", encoding="utf-8", errors="replace", buffering=1) as log:
        out, err = CopiedStream(sys.stdout, log, True), CopiedStream(sys.stderr, log, False)
        with redirect_stdout(cast(TextIO, out)), redirect_stderr(cast(TextIO, err)):
            try:
                yield
            except CompactHydraException:  # told in a sentence before
                raise
            except Exception:  # raised on as it is: only noted
                err.note(traceback.format_exc())
                raise


class CopiedStream:
    """A stream whose whole lines are copied to a log. ``blank``: the empty ones, too.

    What moves the cursor is a progress bar, and is not copied. The log never stops the run: where it can't be written, its
    disk is full, and what the run itself writes there says so.
    """

    def __init__(self, stream: TextIO, log: TextIO, blank: bool) -> None:
        self._stream, self._log, self._blank = stream, log, blank
        self._begun, self._lock = "", threading.Lock()

    def write(self, text: str) -> int:
        """Writes to the stream and, line by line, to the log."""
        written = self._stream.write(text)
        if "\r" not in text and "\x1b" not in text:
            with self._lock:
                *lines, self._begun = (self._begun + text).split("\n")
                self.note("".join(f"{line}\n" for line in lines if line or self._blank))
        return written

    def note(self, text: str) -> None:
        """Writes to the log only; nothing once that is closed."""
        with contextlib.suppress(OSError):
            if not self._log.closed:
                self._log.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
