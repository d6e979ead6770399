"""Process of an isolated FMU, seen from its parent: calls, time limit, end."""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from cosim.component import Component
from cosim.engine import blocks
from cosim.functions import OK, Callbacks
from cosim.isolated_child import child_command, inheritance, open_channel, waiter
from eightpost.errors import EightpostError, FmuError, StepError, TerminatedError

# ---- Callbacks from the loop to a Python component that can save and restore its state ------------------------------


class Restorable(Component, Protocol):
    """Component that can return to earlier states."""

    def save(self) -> object:
        """Return the current state.

        Raises:
            StepError: The component cannot save it.
        """

    def restore(self, state: object) -> None:
        """Restore a state that `save` returned; the state remains valid.

        Raises:
            StepError: The state is not one of this run, or cannot be restored.
        """

    def free(self, state: object) -> None:
        """Free a state that is no longer needed."""


class StateCallbacks(Callbacks):
    """Callbacks including those for states: the loop identifies a state by a number, as an FMU's by an address.

    Args:
        component: Component to call; it must have begun before the loop calls.
    """

    def __init__(self, component: Restorable) -> None:
        super().__init__(component)
        self._restorable = component
        self._numbers = count(1)
        self._states: dict[int, object] = {}

    def _functions(self) -> dict[str, Any]:
        return super()._functions() | {
            "save": blocks.SAVE(self._guarded(self._save)),
            "restore": blocks.RESTORE(self._guarded(self._restore)),
            "free": blocks.SAVE(self._free_quietly),
        }

    def _save(self, slot: int) -> None:
        number = ctypes.c_int64.from_address(slot)
        if number.value in self._states:
            self._restorable.free(self._states.pop(number.value))
        number.value = next(self._numbers)
        self._states[number.value] = self._restorable.save()

    def _restore(self, number: int) -> None:
        self._restorable.restore(self._states[number])

    def _free_quietly(self, _instance: Any, slot: int) -> int:
        """Free a state at the end of a run; errors are ignored, because a failure has been reported already."""
        state = self._states.pop(ctypes.c_int64.from_address(slot).value, None)
        if state is not None:
            with suppress(EightpostError):
                self._restorable.free(state)
        return OK


# ---- Parent side of isolation ---------------------------------------------------------------------------------------

Call = tuple[Any, ...]

_STARTING = 60.0  # s: for Python and fmpy, without the FMU
_CLOSING = 3.0  # s
_PRINTED = 65536  # bytes of the FMU's output per run that are passed on
_ERRORS: dict[str, type[EightpostError]] = {kind.__name__: kind for kind in (StepError, TerminatedError, FmuError)}


class EndedError(Exception):
    """Error for a child that crashed or hung.

    Args:
        how: Description: "crashed (SIGABRT)", "did not respond within 1 s and was ended".
        index: Index of the call in the batch.
        hung: Whether it hung.
    """

    def __init__(self, how: str, index: int, *, hung: bool) -> None:
        super().__init__(how)
        self.how, self.index, self.hung = how, index, hung


class Process:
    """Child process with one FMU. It starts at once; the first request waits for it.

    Args:
        path: FMU file (.fmu).
        name: Name of the component.
        folder: Folder with the unpacked FMU in `fmu`; it is not removed.
        log: Function that takes the level and the text of the FMU's messages.
    """

    def __init__(self, path: Path, name: str, folder: Path, log: Callable[[int, str], None]) -> None:
        self._folder, self._log = folder, log
        shutil.rmtree(folder / "work", ignore_errors=True)  # remove the files of an earlier process
        (folder / "work").mkdir(exist_ok=True)
        (folder / "call").write_bytes(b"\0")
        self._connection, child_end = open_channel()
        arguments = {"channel": child_end.fileno(), "path": str(path), "name": name, "folder": str(folder)}
        with (folder / "printed").open("wb") as printed:
            self._process = subprocess.Popen(
                child_command(arguments),
                stdin=subprocess.PIPE,
                stdout=printed,
                stderr=subprocess.STDOUT,
                cwd=folder,
                **inheritance(child_end),
            )
        child_end.close()
        self._wait = waiter(self._connection)
        self._first, self._read = True, 0
        self.close = weakref.finalize(self, _close, self._process, self._connection, os.getpid())

    def ask(self, calls: Sequence[Call], timeout: float) -> list[Any]:
        """Make calls in order; return the result of each.

        Raises:
            EndedError: The child crashed, or did not respond within `timeout` [s] and was killed.
            StepError: A call failed; the message is that of the component.
        """
        deadline = time.monotonic() + timeout + (_STARTING if self._first else 0.0)
        try:
            self._connection.send_bytes(pickle.dumps(list(calls), pickle.HIGHEST_PROTOCOL))
            answer = self._answer(deadline)
        except (EOFError, OSError):
            raise self._ended() from None
        except BaseException:  # Ctrl-C: the reply would be taken for the reply to the next request
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
        """Return the lines printed since the last call; only the last ones if there are many."""
        with (self._folder / "printed").open("rb") as file:
            file.seek(max(self._read, file.seek(0, os.SEEK_END) - _PRINTED))
            text = file.read()
            self._read = file.tell()
        return [line.rstrip() for line in text.decode("utf-8", "replace").splitlines() if line.strip()]

    @property
    def alive(self) -> bool:
        """Whether the child can be called."""
        return bool(self.close.alive)

    def kill(self) -> None:
        """End the child without a request."""
        _kill(self._process)
        self.close()

    def _answer(self, deadline: float) -> tuple[Any, ...] | None:
        """Return the next reply, passing on the FMU's messages before it; None after the time limit."""
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
            how = f"did not respond within {hung:g} s and was ended"
        self.kill()
        counter = (self._folder / "call").read_bytes()[:1]
        return EndedError(how, int.from_bytes(counter, "little"), hung=hung is not None)


def _close(process: subprocess.Popen[bytes], connection: Any, owner: int) -> None:
    """Let a child end, then force it to; do nothing in a process forked off its owner."""
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
            os.killpg(process.pid, signal.SIGKILL)  # the child's own session, with all that the FMU started
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
