"""What an FMU says: into Python's logging, with printf formats filled in and variables by name."""

from __future__ import annotations

import ctypes
import importlib.util
import logging
import os
import re
import shutil
import tempfile
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmpy
from fmpy import fmi2

#: By FMI status: OK, warning, discard, error, fatal, pending.
LEVELS = (logging.DEBUG, logging.WARNING, logging.WARNING, logging.ERROR, logging.CRITICAL, logging.DEBUG)
_ERROR, _FATAL = 3, 4  # fmi2Status
_VARIABLE = re.compile(r"#(?:#|([ribs]\d+)#)")


class Messages:
    """Warnings and worse, each once; the first hundred of them, for an FMU may write the time into each."""

    _KEPT = 100

    def __init__(self) -> None:
        self._kept: dict[str, None] = {}
        self._last: deque[str] = deque(maxlen=3)
        self._more = 0

    def add(self, text: str) -> None:
        """Take one more; of those that are new, the first hundred are kept and the others counted."""
        self._last.append(text)
        if text in self._kept:
            return
        if len(self._kept) < self._KEPT:
            self._kept[text] = None
        else:
            self._more += 1

    def clear(self) -> None:
        """Forget all."""
        self._kept.clear()
        self._last.clear()
        self._more = 0

    @property
    def all(self) -> tuple[str, ...]:
        """Each once, and how many more there were."""
        return (*self._kept, *([f"and {self._more} messages more"] if self._more else []))

    @property
    def last(self) -> str:
        """The last three as a sentence's end, or that there were none."""
        return "; ".join(dict.fromkeys(self._last)) or "it gave no reason"


class ComponentLog:
    """The log of one component: logger `cosim.fmu.<component>`, and the messages that are warnings or worse.

    It holds no component, so that what writes into it does not keep one alive.

    Args:
        component: Its name.
    """

    def __init__(self, component: str) -> None:
        self.messages = Messages()
        self._logger = logging.getLogger(f"cosim.fmu.{component}")

    def write(self, level: int, text: str) -> None:
        """Log, and keep what is a warning or worse; `level` is one of logging's."""
        self._logger.log(level, "%s", text)
        if level >= logging.WARNING:
            self.messages.add(text)


class FmuLog(ComponentLog):
    """The log of an FMU in this process, which writes by callback; level by FMI status (OK is debug).

    Args:
        component: The component's name.
        names: Variables by the way in which a message may name them, "r12" for "#r12#".
        folder: Where it is unpacked; a library of this log's own goes there.
    """

    def __init__(self, component: str, names: Mapping[str, str], folder: Path) -> None:
        super().__init__(component)
        self.errors = 0
        self._names = names
        self._formatter = _load_formatter(folder)
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self._entry = fmi2.fmi2CallbackLoggerTYPE(self._take)
        self.callbacks.logger = self._entry
        if self._formatter is not None:
            self._formatter.addLoggerProxy(ctypes.byref(self.callbacks))

    def close(self) -> None:
        """Let go of the library; the FMU must not write any more."""
        formatter, self._formatter = self._formatter, None
        if formatter is not None:
            fmpy.freeLibrary(formatter._handle)

    def _take(self, _environment: Any, _instance: Any, status: int, _category: Any, message: Any) -> None:
        raw = message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)
        text = _VARIABLE.sub(self._name, raw).strip()
        if 0 <= status < len(LEVELS):
            self.write(LEVELS[status], text)
        else:
            self._logger.error("%s", text)
        self.errors += status in (_ERROR, _FATAL)

    def _name(self, found: re.Match[str]) -> str:
        return "#" if found[1] is None else self._names.get(found[1], found[0])


def _load_formatter(folder: Path) -> Any:
    """Load a copy of fmpy's library that fills in printf formats, which ctypes cannot; None where there is none.

    It serves one callback at a time for all who load it, hence a copy each.
    """
    spec = importlib.util.find_spec("fmpy.logging")
    if spec is None or spec.origin is None:
        return None
    library = Path(spec.origin).parent / fmpy.platform / f"logging{fmpy.sharedLibraryExtension}"
    if not library.is_file():
        return None
    number, copy = tempfile.mkstemp(prefix="log_formatter_", suffix=fmpy.sharedLibraryExtension, dir=folder)
    os.close(number)
    shutil.copyfile(library, copy)
    formatter = ctypes.CDLL(copy)
    formatter.addLoggerProxy.argtypes, formatter.addLoggerProxy.restype = [ctypes.c_void_p], None
    return formatter
