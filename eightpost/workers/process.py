"""Processes that this process starts: their command, end and time limit, and those that answer requests."""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

# ==== Command, end with this process, and time limit =================================================================

#: Folder of the packages eightpost, builder and cosim.
ROOT = Path(__file__).resolve().parents[2]

#: Time between two checks of the parent, and time for a child with a folder to end by itself after its parent [s].
_LOOK, _PATIENCE = 0.5, 1.0


# ---- Command of a Python process ------------------------------------------------------------------------------------


def _import_path() -> list[str]:
    """Return this process's import path for a child: absolute, and without the current folder.

    Python searches the current folder first (`python -m`, `python -c`, a notebook), and a user's file there may have
    the name of a module.
    """
    here = Path.cwd()
    entries = [here / entry for entry in sys.path]
    kept = [str(entry) for entry in entries if entry != here or entry.resolve() == ROOT]
    return list(dict.fromkeys(kept if str(ROOT) in kept else [*kept, str(ROOT)]))


def python_command(module: str, *arguments: str, bare: str = "", folder: str = "") -> list[str]:
    """Return the command that runs a module in a new interpreter with this process's import path.

    The new process ends when this one ends.

    Args:
        module: Module to run as a program.
        arguments: Arguments of the module.
        bare: Package whose own imports are skipped, because they take seconds (scipy, pint).
        folder: Folder that the new process removes when this one has ended.
    """
    code = (
        f"import sys; sys.path[:] = {_import_path()!r}; from eightpost.workers import process; "
        f"process.end_with({os.getpid()}, {folder!r}); process.run_module({module!r}, {bare!r})"
    )
    return [sys.executable, "-P", "-c", code, *arguments]


def run_module(module: str, bare: str = "") -> None:
    """Run a module as a program; see `python_command`."""
    import runpy  # noqa: PLC0415 -- needed in a child only
    import types  # noqa: PLC0415

    if bare:
        package = sys.modules[bare] = types.ModuleType(bare)
        package.__path__ = [str(ROOT / bare)]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


# ---- Child processes that end when their parent ends, even if the parent is killed ----------------------------------


def end_with(parent: int, folder: str = "") -> None:
    """End this process within a second after its parent has ended.

    Args:
        parent: Process number of the parent. It is an argument because, if the parent ended before this call,
            os.getppid() returns another process.
        folder: Folder to remove then; the process gets a second more, so that it can end by itself.
    """
    threading.Thread(target=_end_after, args=(parent, folder), name="end with parent", daemon=True).start()


def _end_after(parent: int, folder: str) -> None:
    _wait(parent)
    if folder:
        time.sleep(_PATIENCE)
    leave(folder)


def leave(folder: str = "") -> None:
    """Remove a folder, and end this process; if it leads its process group, end all that it started, too."""
    if folder:
        from eightpost.marks import remove_folder  # noqa: PLC0415 -- needed at the end only

        os.chdir(Path(folder).parent)
        remove_folder(Path(folder))
    if sys.platform != "win32" and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _wait(parent: int) -> None:
    """Return when the parent has ended."""
    if sys.platform == "win32":
        import ctypes  # noqa: PLC0415 -- only there

        synchronize, forever = 0x00100000, 0xFFFFFFFF
        kernel = ctypes.WinDLL("kernel32")
        kernel.OpenProcess.restype = ctypes.c_void_p
        if handle := kernel.OpenProcess(synchronize, False, parent):
            kernel.WaitForSingleObject(ctypes.c_void_p(handle), forever)
        return
    while os.getppid() == parent:
        time.sleep(_LOOK)


# ---- Processes that do one thing ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Ended:
    """A process that has ended: its exit code, and what it printed."""

    code: int | None  #: Exit code; negative for a signal, None if the process was ended after its time limit.
    output: bytes  #: Standard output, and standard error if both were to be kept together.
    errors: bytes = b""  #: Standard error.


def run(
    command: Sequence[str],
    seconds: float | None = None,
    *,
    folder: str | Path | None = None,
    environment: Mapping[str, str] | None = None,
    together: bool = False,
    tree: bool = False,
    question: bytes = b"",
) -> _Ended:
    """Run a command until it ends or `seconds` have passed, then end it.

    Args:
        command: Command and its arguments.
        seconds: Time limit [s]; None for none.
        folder: Working folder; None for this process's.
        environment: Environment variables; None for this process's.
        together: Whether to keep standard error in the standard output.
        tree: Whether the processes that it starts are ended with it.
        question: Content of its standard input.
    """
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        given.write(question)
        given.seek(0)
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=None if environment is None else dict(environment),
            stdin=given,
            stdout=output,
            stderr=subprocess.STDOUT if together else errors,
            **(own_group() if tree else {}),
        )
        try:
            code: int | None = process.wait(seconds)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            if process.poll() is None:
                kill(process, tree=tree)
        output.seek(0)
        errors.seek(0)
        return _Ended(code, output.read(), errors.read())


def own_group() -> dict[str, Any]:
    """Return the arguments of `subprocess.Popen` for a process that does not receive Ctrl-C and leads its own group."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}


def kill(process: subprocess.Popen[Any], *, tree: bool) -> None:
    """Kill a process, and if `tree`, its process group with all that it started; wait for its end."""
    if sys.platform == "win32" or not tree:
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _signal_name(code: int) -> str:
    """Return the name of the signal that ended a process with a negative exit code."""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


# ---- Number of processors that this process may use -----------------------------------------------------------------


def usable_processors() -> int:
    """Return the number of processors that this process may use; if the system does not report it, all processors."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on Windows and macOS
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


# ==== A child that answers requests one after the other, and the channel to it =======================================

#: Time for a child to end after its channel was closed [s].
_CLOSING = 3.0


class EndedError(Exception):
    """Error for a child that crashed or hung.

    Args:
        how: Description: "crashed (SIGABRT)", "did not respond within 1 s and was ended".
        code: Exit code, negative for a signal; None if it only closed its channel.
        hung: Whether it exceeded the time limit.
    """

    def __init__(self, how: str, code: int | None, *, hung: bool) -> None:
        super().__init__(how)
        self.how, self.code, self.hung = how, code, hung


class Child:
    """A child process. It starts at once; the first request waits for it.

    Args:
        module: Module that the child runs; its first argument is the number for `ParentChannel`.
        arguments: Further arguments of the module.
        bare: Package whose own imports are skipped.
        folder: Folder that the child removes when this process has ended.
        starting: Additional time for the first reply, in which the child imports its modules [s].
        options: Further arguments of `subprocess.Popen`.
    """

    def __init__(
        self, module: str, *arguments: str, bare: str = "", folder: str = "", starting: float = 0.0, **options: Any
    ) -> None:
        self._connection, end = Pipe(duplex=True)
        command = python_command(module, str(end.fileno()), *arguments, bare=bare, folder=folder)
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, **options, **_inheritance(end)
        )
        end.close()
        self._wait = _waiter(self._connection)
        self._starting, self.owner = starting, os.getpid()
        self.close = weakref.finalize(self, _close, self._process, self._connection.close, self.owner)

    def ask(self, request: Any, seconds: float, notice: Callable[[Any], None] = lambda _: None) -> Any:
        """Send a request and return the reply.

        Args:
            request: Request; any object that can be pickled.
            seconds: Time limit [s], after which the child is ended.
            notice: Function that takes what the child reports before the reply.

        Raises:
            EndedError: The child crashed, or did not reply within the time limit.
        """
        until = time.monotonic() + seconds + self._starting
        try:
            self._connection.send_bytes(pickle.dumps(request, pickle.HIGHEST_PROTOCOL))
            while self._wait(max(0.0, until - time.monotonic())):
                is_reply, content = pickle.loads(self._connection.recv_bytes())
                if is_reply:
                    self._starting = 0.0
                    return content
                notice(content)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._crashed() from None
        except BaseException:  # Ctrl-C: the reply would be taken for the reply to the next request
            self.kill()
            raise
        self.kill()
        raise EndedError(f"did not respond within {seconds:g} s and was ended", None, hung=True)

    @property
    def alive(self) -> bool:
        """Whether the child can be asked."""
        return bool(self.close.alive)

    def kill(self) -> None:
        """End the child without a request."""
        kill(self._process, tree=True)
        self.close()

    def _crashed(self) -> EndedError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_CLOSING)
        code = self._process.poll()
        self.kill()
        if code is None:
            how = "it closed its channel"
        else:
            how = f"its process ended with code {code}" if code >= 0 else _signal_name(code)
        return EndedError(f"crashed ({how})", code, hung=False)


def _close(process: subprocess.Popen[bytes], close: Callable[[], None], owner: int) -> None:
    """Let a child end, then force it to; do nothing in a process forked off its owner."""
    if os.getpid() != owner:
        return
    close()
    try:
        process.wait(_CLOSING)
    except subprocess.TimeoutExpired:
        kill(process, tree=True)


def _inheritance(end: Any) -> dict[str, Any]:
    """Return the arguments of `subprocess.Popen` with which a child, in its own process group, inherits only the end.

    In its own group it can be ended together with all processes that it started.
    """
    if sys.platform == "win32":
        handle = end.fileno()
        os.set_handle_inheritable(handle, True)
        return {"startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]}), **own_group()}
    return {"pass_fds": (end.fileno(),), **own_group()}


def _waiter(end: Any) -> Callable[[float], bool]:
    """Return a function that waits up to a number of seconds for data to read, and returns whether there is any."""
    if sys.platform == "win32":
        return lambda seconds: bool(end.poll(seconds))
    else:  # Connection.poll creates a selector at each call, which takes longer than the reply of a fast FMU
        poll = select.poll()
        poll.register(end.fileno(), select.POLLIN)
        return lambda seconds: bool(poll.poll(seconds * 1e3))


# ---- In the child ---------------------------------------------------------------------------------------------------


class ParentChannel:
    """The child's end of the channel: requests of the parent, replies, and notices before a reply."""

    def __init__(self, number: str) -> None:
        if sys.platform == "win32":
            from multiprocessing.connection import PipeConnection  # noqa: PLC0415

            self._connection: Any = PipeConnection(int(number))
        else:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            self._connection = Connection(int(number))

    def serve(self, answer: Callable[[Any], Any], unsendable: Callable[[Exception], Any] | None = None) -> None:
        """Answer requests until the parent closes the channel or ends."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                reply = answer(pickle.loads(self._connection.recv_bytes()))
                try:
                    self._send(True, reply)
                except (EOFError, OSError):
                    raise
                except Exception as error:
                    if unsendable is None:
                        raise
                    self._send(True, unsendable(error))

    def notify(self, content: Any) -> None:
        """Report something before the reply."""
        self._send(False, content)

    def _send(self, is_reply: bool, content: Any) -> None:
        self._connection.send_bytes(pickle.dumps((is_reply, content), pickle.HIGHEST_PROTOCOL))
