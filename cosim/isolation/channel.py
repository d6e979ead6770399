"""Channel between the parent and a child process, and its inheritance by the child."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Callable, Mapping
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from eightpost.interpreter import import_path


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
    package = __package__.partition(".")[0]
    folder = str(Path(__file__).parents[1])
    code = (
        "import sys, types\n"
        f"sys.path[:] = {import_path()!r}\n"
        f"package = sys.modules[{package!r}] = types.ModuleType({package!r})\n"
        f"package.__path__ = [{folder!r}]\n"
        f"from {__package__}.child import serve\n"
        f"serve(**{dict(arguments)!r})\n"
    )
    return [sys.executable, "-P", "-c", code]
