"""Commands that run in processes of their own, with their progress and their end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eightpost.workers.process import kill, own_group, python_command

#: Time for a command to end by itself after it was cancelled [s].
PATIENCE = 20.0

#: A line of progress: "setups: 120 of 2401, 5%, about 0:01:10 left".
_PROGRESS = re.compile(r"^[^:\n]+: (?:[\d.e+]+ of [\d.e+]+, )?(?P<percent>\d+)%.*$", re.MULTILINE)


@dataclass
class Job:
    """Commands that run one after the other, until one does not end with 0. They end when this program ends."""

    title: str  #: What it does, for people.
    commands: Sequence[Sequence[str]]  #: Words of each command after `eightpost`.
    folder: Path  #: Working folder.
    product: Path  #: File or folder that it writes.
    _cancelled: float | None = None

    def __post_init__(self) -> None:
        handle, name = tempfile.mkstemp(prefix="eightpost_", suffix=".log")
        os.close(handle)
        self._log, self._left = Path(name), list(self.commands)
        self._process = self._start(self._left.pop(0))

    def _start(self, words: Sequence[str]) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            return subprocess.Popen(
                python_command("eightpost", *words),
                cwd=self.folder,
                env={**os.environ, "EIGHTPOST_PROGRESS": "0.5", "NO_COLOR": "1", "COLUMNS": "100"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                **own_group(),
            )

    @property
    def code(self) -> int | None:
        """Exit code of the last command; None while one runs."""
        return self.advance()

    def advance(self) -> int | None:
        """Start the next command if one has ended, or kill one that does not stop; return the exit code of the last."""
        code = self._process.poll()
        if code == 0 and self._left and self._cancelled is None:
            self._process = self._start(self._left.pop(0))
            return None
        if code is None and self._cancelled is not None and time.monotonic() - self._cancelled > PATIENCE:
            kill(self._process, tree=True)
            code = self._process.poll()
        return code

    @property
    def state(self) -> str:
        """`running`, `stopping`, `cancelled`, `done`, `not acceptable` (exit code 1) or `failed`."""
        code = self.code
        if code is None:
            return "running" if self._cancelled is None else "stopping"
        if self._cancelled is not None:
            return "cancelled"
        return {0: "done", 1: "not acceptable"}.get(code, "failed")

    def cancel(self) -> None:
        """Ask the command to stop, as Ctrl-C does; it is killed if it takes longer than `PATIENCE`."""
        if self.code is None and self._cancelled is None:
            self._cancelled = time.monotonic()
            if os.name == "nt":
                kill(self._process, tree=True)
            else:
                os.killpg(self._process.pid, signal.SIGINT)

    def close(self) -> None:
        """End the command at once, and all that it started."""
        if self._process.poll() is None:
            kill(self._process, tree=True)
        self._log.unlink(missing_ok=True)

    @property
    def log(self) -> str:
        """All that it printed, without the lines of progress."""
        return "\n".join(line for line in self._printed().splitlines() if not _PROGRESS.match(line)).strip()

    @property
    def progress(self) -> tuple[float | None, str]:
        """Share of the work that is done, None if it is not known, and its last line of progress."""
        found = list(_PROGRESS.finditer(self._printed()))
        if not found:
            return None, ""
        return int(found[-1]["percent"]) / 100.0, found[-1].group().strip()

    def _printed(self) -> str:
        return self._log.read_bytes().decode("utf-8", "replace")
