"""A child process that answers requests one after the other, and the channel between it and its parent."""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from eightpost.workers.process import kill, own_group, python_command, signal_name

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
        module: Module that the child runs; its first argument is the number for `parent_channel`.
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
            how = f"its process ended with code {code}" if code >= 0 else signal_name(code)
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
    # Connection.poll creates a selector at each call, which takes longer than the reply of a fast FMU.
    poll = select.poll()
    poll.register(end.fileno(), select.POLLIN)
    return lambda seconds: bool(poll.poll(seconds * 1e3))


# ---- In the child ---------------------------------------------------------------------------------------------------


class ParentChannel:
    """The child's end of the channel: requests of the parent, replies, and notices before a reply.

    Args:
        number: First argument of the child's module.
    """

    def __init__(self, number: str) -> None:
        if sys.platform == "win32":
            from multiprocessing.connection import PipeConnection  # noqa: PLC0415

            self._connection: Any = PipeConnection(int(number))
        else:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            self._connection = Connection(int(number))

    def serve(self, answer: Callable[[Any], Any], unsendable: Callable[[Exception], Any] | None = None) -> None:
        """Answer requests until the parent closes the channel or ends.

        Args:
            answer: Function that takes a request and returns the reply.
            unsendable: Function that takes the error for a reply that cannot be pickled, and returns another reply.
        """
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
