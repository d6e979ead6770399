"""Child process of an isolated component: an FMU and the calls that the parent sends."""

from __future__ import annotations

import ctypes
import logging
import mmap
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from cosim.components.fmu_component import FmuComponent
from eightpost.errors import EightpostError
from eightpost.workers.process import ParentChannel, leave

_LINE_BUFFERED = 1  # glibc's _IOLBF


def serve(channel: str, path: str, name: str, folder: str) -> None:
    """Run an FMU for the parent until the parent closes the channel or ends.

    Args:
        channel: Number of the channel.
        path: FMU file (.fmu).
        name: Name of the component.
        folder: Folder with the unpacked FMU in `fmu`, the working folder `work` and the counter of calls `call`.
    """
    with suppress(Exception):  # works with glibc; elsewhere the last lines before a crash may be lost in the buffer
        library = ctypes.CDLL(None)
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, _LINE_BUFFERED, 0)
    parent = ParentChannel(channel)
    os.chdir(Path(folder, "work"))
    with Path(folder, "call").open("r+b") as counter:
        component = FmuComponent(path, name, folder=Path(folder, "fmu"))
        parent.serve(_Service(parent, component, name, counter).answer)
        component.finish()
        component.close()
    _flush()
    leave(folder)


class _Service:
    """Answers to batches of calls; each saved state has the number that the parent gave it."""

    def __init__(self, parent: ParentChannel, component: FmuComponent, name: str, counter: Any) -> None:
        self._component = component
        self._states: dict[int, object] = {}
        self._counter = mmap.mmap(counter.fileno(), 1)
        logger = logging.getLogger(f"cosim.fmu.{name}")
        logger.setLevel(logging.DEBUG)
        logger.propagate = False
        logger.addHandler(_Forward(parent))

    def answer(self, batch: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        """Make calls in order; return ("done", results), or ("failed", ...) with the first error."""
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

    def __init__(self, parent: ParentChannel) -> None:
        super().__init__()
        self._parent = parent

    def emit(self, record: logging.LogRecord) -> None:
        """Send one message."""
        self._parent.notify((record.levelno, record.getMessage()))


def _flush() -> None:
    """Flush the FMU's output from the C library's buffer, if this process shares that library."""
    with suppress(Exception):
        ctypes.CDLL(None).fflush(None)


if __name__ == "__main__":
    serve(*sys.argv[1:])
