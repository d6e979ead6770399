"""Child process of an isolated component: an FMU and the calls that the parent sends."""

from __future__ import annotations

import ctypes
import logging
import mmap
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from cosim.fmu_component import FmuComponent
from cosim.fmu_file import remove
from eightpost.errors import EightpostError
from eightpost.interpreter import import_path

# ---- Channel between the parent and a child process, and its inheritance by the child -------------------------------


def open_channel() -> tuple[Any, Any]:
    """Return the parent's end and the child's."""
    return Pipe(duplex=True)


def inheritance(end: Any) -> dict[str, Any]:
    """Return the arguments of `subprocess.Popen` with which the child, in its own process group, inherits only the end.

    In its own group it does not receive Ctrl-C, and can be ended together with all processes that the FMU started.
    """
    if sys.platform == "win32":
        handle = end.fileno()
        os.set_handle_inheritable(handle, True)
        start = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})
        return {"startupinfo": start, "creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"pass_fds": (end.fileno(),), "start_new_session": True}


def waiter(end: Any) -> Callable[[float], bool]:
    """Return a function that waits up to a number of seconds for data to read, and returns whether there is any."""
    if sys.platform == "win32":
        return lambda seconds: bool(end.poll(seconds))
    # Connection.poll creates a selector at each call, which takes longer than the reply of a fast FMU.
    poll = select.poll()
    poll.register(end.fileno(), select.POLLIN)
    return lambda seconds: bool(poll.poll(seconds * 1e3))


def take_channel(number: int) -> Any:
    """Return the channel end for the number that the parent obtained from `fileno()`."""
    if sys.platform == "win32":
        from multiprocessing.connection import PipeConnection  # noqa: PLC0415

        return PipeConnection(number)
    return Connection(number)


def child_command(arguments: Mapping[str, Any]) -> list[str]:
    """Return the command of a child process; it imports modules from the same folders as this process.

    A child needs little of `cosim`, so it skips the package's own imports, which take seconds (scipy, pint).
    """
    folder = str(Path(__file__).parent)
    code = (
        "import sys, types\n"
        f"sys.path[:] = {import_path()!r}\n"
        f"package = sys.modules[{__package__!r}] = types.ModuleType({__package__!r})\n"
        f"package.__path__ = [{folder!r}]\n"
        f"from {__name__} import serve\n"
        f"serve(**{dict(arguments)!r})\n"
    )
    return [sys.executable, "-P", "-c", code]


# ---- Child side of isolation ----------------------------------------------------------------------------------------

_LINE_BUFFERED = 1  # glibc's _IOLBF
_PATIENCE = 1.0  # s: time for an FMU to end after the parent has ended


def serve(*, channel: int, path: str, name: str, folder: str) -> None:
    """Run an FMU for the parent until the parent closes the channel or ends.

    Args:
        channel: Number of the channel.
        path: FMU file (.fmu).
        name: Name of the component.
        folder: Folder with the unpacked FMU in `fmu`, the working folder `work` and the counter of calls `call`.
    """
    lifeline = _take_standard_streams()
    connection = take_channel(channel)
    ended = threading.Event()
    watch = threading.Thread(target=_end_with_parent, args=(lifeline, ended, folder), daemon=True)
    watch.start()
    os.chdir(Path(folder, "work"))
    with Path(folder, "call").open("r+b") as counter:
        component = FmuComponent(path, name, folder=Path(folder, "fmu"))
        _Service(connection, component, name, counter).run()
        component.close()
    _flush()
    ended.set()
    watch.join()


class _Service:
    """Server for batches of calls; each saved state has the number that the parent gave it."""

    def __init__(self, connection: Any, component: FmuComponent, name: str, counter: Any) -> None:
        self._connection, self._component = connection, component
        self._states: dict[int, object] = {}
        self._counter = mmap.mmap(counter.fileno(), 1)
        logger = logging.getLogger(f"cosim.fmu.{name}")
        logger.setLevel(logging.DEBUG)
        logger.propagate = False
        logger.addHandler(_Forward(connection))

    def run(self) -> None:
        """Serve calls until the parent closes the channel."""
        while True:
            try:
                batch = pickle.loads(self._connection.recv_bytes())
                _send(self._connection, self._answer(batch))
            except (EOFError, OSError):
                self._component.finish()
                return

    def _answer(self, batch: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        results = []
        for index, (what, *arguments) in enumerate(batch):
            self._counter[0] = min(index, 255)  # the counter keeps this value after a crash
            try:
                results.append(self._call(what, arguments))
            except EightpostError as error:
                return "failed", type(error).__name__, str(error), self._component.usable
        return "done", results

    def _call(self, what: str, arguments: Sequence[Any]) -> Any:
        if what == "save":
            self._states[arguments[0]] = self._component.save()
        elif what == "restore":
            self._component.restore(self._states[arguments[0]])
        elif what == "free":
            self._component.free(self._states.pop(arguments[0]))
        else:
            if what == "begin":
                self._states.clear()
            result = getattr(self._component, what)(*arguments)
            if what == "finish":
                _flush()
            return result
        return None


class _Forward(logging.Handler):
    """Log handler that sends messages at once, so that the last messages before a crash arrive."""

    def __init__(self, connection: Any) -> None:
        super().__init__()
        self._connection = connection

    def emit(self, record: logging.LogRecord) -> None:
        """Send one message."""
        _send(self._connection, ("log", record.levelno, record.getMessage()))


def _send(connection: Any, message: tuple[Any, ...]) -> None:
    connection.send_bytes(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))


def _take_standard_streams() -> int:
    """Replace stdin, which signals the parent's end, so that the FMU reads nothing; set line buffering of stdout."""
    lifeline = os.dup(0)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    with suppress(Exception):  # works with glibc; elsewhere the last lines before a crash may be lost in the buffer
        library = ctypes.CDLL(None)
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, _LINE_BUFFERED, 0)
    if sys.platform != "win32":
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return lifeline


def _flush() -> None:
    """Flush the FMU's output from the C library's buffer, if this process shares that library."""
    with suppress(Exception):
        ctypes.CDLL(None).fflush(None)


def _end_with_parent(lifeline: int, ended: threading.Event, folder: str) -> None:
    """Wait for the parent's end, then remove the folder and end this process group, with all that the FMU started."""
    while os.read(lifeline, 1):
        pass
    ended.wait(_PATIENCE)
    os.chdir(Path(folder).parent)
    remove(folder)
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    os._exit(0)
