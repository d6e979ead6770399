"""The parent's side: a child started, asked, timed and ended."""

from __future__ import annotations

import contextlib
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cosim.isolation.channel import child_command, inheritance, open_channel, waiter
from eightpost.errors import EightpostError, FmuError, StepError, TerminatedError

Call = tuple[Any, ...]

_STARTING = 60.0  # s: python and fmpy, not the FMU
_CLOSING = 3.0  # s
_PRINTED = 65536  # bytes of what it printed in a run that are passed on
_ERRORS: dict[str, type[EightpostError]] = {kind.__name__: kind for kind in (StepError, TerminatedError, FmuError)}


class EndedError(Exception):
    """The child crashed or hung.

    Args:
        how: "crashed (SIGABRT)", "gave no answer within 1 s and was ended".
        index: Of the call in the batch.
        hung: Whether it hung.
    """

    def __init__(self, how: str, index: int, *, hung: bool) -> None:
        super().__init__(how)
        self.how, self.index, self.hung = how, index, hung


class Process:
    """A child with one FMU. It starts at once and is waited for with the first question.

    Args:
        path: The .fmu file.
        name: The component's.
        folder: Holds the FMU unpacked in `fmu`; it stays.
        log: Takes level and text of what the FMU says.
    """

    def __init__(self, path: Path, name: str, folder: Path, log: Callable[[int, str], None]) -> None:
        self._folder, self._log = folder, log
        shutil.rmtree(folder / "work", ignore_errors=True)  # what another process left there is not to be found
        (folder / "work").mkdir(exist_ok=True)
        (folder / "call").write_bytes(b"\0")
        self._connection, theirs = open_channel()
        arguments = {"channel": theirs.fileno(), "path": str(path), "name": name, "folder": str(folder)}
        with (folder / "printed").open("wb") as printed:
            self._process = subprocess.Popen(
                child_command(arguments),
                stdin=subprocess.PIPE,
                stdout=printed,
                stderr=subprocess.STDOUT,
                cwd=folder,
                **inheritance(theirs),
            )
        theirs.close()
        self._wait = waiter(self._connection)
        self._first, self._read = True, 0
        self.close = weakref.finalize(self, _close, self._process, self._connection, os.getpid())

    def ask(self, calls: Sequence[Call], timeout: float) -> list[Any]:
        """Have calls done in order; return what each returned.

        Raises:
            EndedError: The child crashed, or did not answer within `timeout` [s] and was killed.
            StepError: A call failed; the message is the component's own.
        """
        deadline = time.monotonic() + timeout + (_STARTING if self._first else 0.0)
        try:
            self._connection.send_bytes(pickle.dumps(list(calls), pickle.HIGHEST_PROTOCOL))
            answer = self._answer(deadline)
        except (EOFError, OSError):
            raise self._ended() from None
        except BaseException:  # Ctrl-C: the answer would be taken for that to the next question
            self.kill()
            raise
        if answer is None:
            raise self._ended(hung=timeout)
        self._first = False
        if answer[0] == "done":
            return list(answer[1])
        _, kind, message, usable = answer
        if not usable:
            self.kill()
        raise _ERRORS.get(kind, StepError)(message)

    def printed(self) -> list[str]:
        """Return the lines that it printed since the last time, the last ones of many."""
        with (self._folder / "printed").open("rb") as file:
            file.seek(max(self._read, file.seek(0, os.SEEK_END) - _PRINTED))
            text = file.read()
            self._read = file.tell()
        return [line.rstrip() for line in text.decode("utf-8", "replace").splitlines() if line.strip()]

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return bool(self.close.alive)

    def kill(self) -> None:
        """End it without asking."""
        _kill(self._process)
        self.close()

    def _answer(self, deadline: float) -> tuple[Any, ...] | None:
        """Return the next answer, passing on what the FMU says before it; None if the time is over."""
        while self._wait(max(0.0, deadline - time.monotonic())):
            answer: tuple[Any, ...] = pickle.loads(self._connection.recv_bytes())
            if answer[0] != "log":
                return answer
            self._log(*answer[1:])
        return None

    def _ended(self, hung: float | None = None) -> EndedError:
        if hung is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_CLOSING)
            how = f"crashed ({_how(self._process.poll())})"
        else:
            how = f"gave no answer within {hung:g} s and was ended"
        self.kill()
        counter = (self._folder / "call").read_bytes()[:1]
        return EndedError(how, int.from_bytes(counter, "little"), hung=hung is not None)


def _close(process: subprocess.Popen[bytes], connection: Any, owner: int) -> None:
    """Let a child end, then make it end; not in a process forked off its owner."""
    if os.getpid() != owner:
        return
    connection.close()
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(_CLOSING)
    except subprocess.TimeoutExpired:
        _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # a session of its own: with all that the FMU started
    process.wait()


def _how(code: int | None) -> str:
    if code is None:
        return "it closed its channel"
    if code >= 0:
        return f"its process ended with code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
