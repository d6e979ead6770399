"""Parent side of confined reading: requests to the child process, with a time limit and a restart after a crash."""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import signal
import subprocess
import threading
from pathlib import Path
from typing import IO, Any, cast

from eightpost.confined.channel import receive, send
from eightpost.errors import FileFormatError
from eightpost.files import reading
from eightpost.interpreter import python_command

#: Memory that the child may use in addition to its libraries [bytes]: a minimum, and a multiple of the file size.
MEMORY, _MEMORY_PER_BYTE = 2 * 2**30, 8
#: Time limit for one file [s], and additional time for each byte [s].
_TIME, _TIME_PER_BYTE = 60.0, 1e-6
#: Time limit for a process to end after it closed its output [s].
_ENDING = 5.0


class _EndedError(Exception):
    """Exception for a child that crashed, or that was killed because it exceeded the time limit.

    Args:
        how: Description of what happened, for a message.
        late: Whether the child exceeded the time limit.
    """

    def __init__(self, how: str, *, late: bool) -> None:
        super().__init__(how)
        self.late = late


class _Child:
    """A process that reads one file after the other until its standard input is closed."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            python_command("eightpost.confined.child"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        self.owner = os.getpid()

    def ask(self, question: tuple[Any, ...], seconds: float) -> Any:
        """Return the child's answer to a request.

        Raises:
            _EndedError: The child crashed, or did not answer within `seconds`.
        """
        late = threading.Event()
        timer = threading.Timer(seconds, self._expire, (late,))
        timer.start()
        try:
            send(cast("IO[bytes]", self._process.stdin), pickle.dumps(question))
            return pickle.loads(receive(cast("IO[bytes]", self._process.stdout)))
        except (OSError, EOFError, pickle.UnpicklingError):
            code = self._ended()
            how = f"took longer than {seconds:.0f} s" if late.is_set() else _how(code)
            raise _EndedError(how, late=late.is_set()) from None
        except BaseException:  # Ctrl-C: the pending answer would be read as the answer to the next request
            self.end()
            raise
        finally:
            timer.cancel()

    def _expire(self, late: threading.Event) -> None:
        late.set()
        self._process.kill()

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self.close()

    def _ended(self) -> int:
        """Return the exit code of a process that closed its side of the pipe; kill it if it is still running."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDING)
        self.end()
        return int(self._process.returncode)

    def close(self) -> None:
        """Close the pipes and wait; the process ends when its standard input is closed."""
        for stream in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                cast("IO[bytes]", stream).close()
        self._process.wait()


_lock = threading.Lock()
_children: list[_Child] = []


def read_confined(function: str, path: str | Path, *options: Any, kind: str) -> Any:
    """Call a function with a file in the child process, and return its result.

    Args:
        function: Module and function, `package.module:name`, called with the path and the options.
        path: Path of the file.
        options: Further arguments; they and the result must be picklable.
        kind: Expected type of file, for messages: "a MATLAB file".

    Raises:
        FileFormatError: The library cannot read the file, crashed, or exceeded the memory or time limit.
        EightpostError: An error that the function raised itself.
    """
    path = Path(path)
    with reading(path):
        size = path.stat().st_size
        path.open("rb").close()
    question = (function, str(path.absolute()), options, max(MEMORY, _MEMORY_PER_BYTE * size))
    try:
        outcome, answer = _answer(question, _TIME + _TIME_PER_BYTE * size)
    except _EndedError as error:
        what = f"not {kind}: the process that read it {error}; the file is damaged, export or copy it again"
        raise FileFormatError(what, path=path) from None
    if outcome == "refused":
        raise answer
    if outcome == "failed":
        raise FileFormatError(f"not {kind}: {answer}", path=path)
    return answer


def _answer(question: tuple[Any, ...], seconds: float) -> Any:
    """Send a request to the child. If it crashes, retry with a new child, because an earlier file may be the cause."""
    with _lock:
        used = bool(_children) and _children[0].owner == os.getpid()
        if used:
            try:
                return _children[0].ask(question, seconds)
            except _EndedError as error:
                _children.clear()
                if error.late:
                    raise
        _children[:] = [_Child()]
        try:
            return _children[0].ask(question, seconds)
        except _EndedError:
            _children.clear()
            raise


@atexit.register
def _close() -> None:
    for child in _children:
        if child.owner == os.getpid():
            child.close()
    _children.clear()


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with code {code}"
    try:
        return f"crashed ({signal.Signals(-code).name})"
    except ValueError:
        return f"crashed (signal {-code})"
