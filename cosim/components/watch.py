"""What FMUs report and do to the process: log messages, errors of failed calls, process state, the current call."""

from __future__ import annotations

import atexit
import ctypes
import ctypes.util
import importlib.util
import logging
import mmap
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import fmi2
from numpy.typing import NDArray

from cosim.components.component import Capabilities, Variable
from cosim.components.fmu_file import FmuFile
from eightpost.errors import StepError
from eightpost.fmi import DISCARD, ERROR, FATAL, PENDING
from eightpost.validity import Validity
from eightpost.workers import supervision
from eightpost.workers.supervision import SIZE, Record

# ==== Log messages of FMUs, and the errors that a failed call of an FMU causes =======================================


# ---- Messages of an FMU, written to Python's logging with printf formats filled in and variables by name ------------

#: By FMI status: OK, warning, discard, error, fatal, pending.
LEVELS = (logging.DEBUG, logging.WARNING, logging.WARNING, logging.ERROR, logging.CRITICAL, logging.DEBUG)
#: "#r12#" in FMI 2.0, "#12#" in FMI 3.0.
_VARIABLE = re.compile(r"#(?:#|([ribs]?\d+)#)")


class Messages:
    """Warnings and more severe messages, each once; the first hundred, because an FMU may write the time into each."""

    _MOST = 100

    def __init__(self) -> None:
        self._first: dict[str, None] = {}
        self._last: deque[str] = deque(maxlen=3)
        self._more = 0

    def add(self, text: str) -> None:
        """Add a message; the first hundred different ones are kept and the others counted."""
        self._last.append(text)
        if len(self._first) < self._MOST:
            self._first[text] = None
        elif text not in self._first:
            self._more += 1

    def clear(self) -> None:
        """Remove all messages."""
        self._first.clear()
        self._last.clear()
        self._more = 0

    @property
    def all(self) -> tuple[str, ...]:
        """All messages, each once, and the number of those not kept."""
        return (*self._first, *([f"and {self._more} more messages"] if self._more else []))

    @property
    def last(self) -> str:
        """Last three messages for the end of a sentence, or `none`."""
        return "; ".join(dict.fromkeys(self._last)) or "none"


class ComponentLog:
    """Log of one component: logger `cosim.fmu.<component>`, and its warnings and more severe messages.

    It does not reference the component, so it does not keep the component alive.
    """

    def __init__(self, component: str) -> None:
        self.messages = Messages()
        self._logger = logging.getLogger(f"cosim.fmu.{component}")

    def write(self, level: int, text: str) -> None:
        """Write to the log, and keep the text if it is a warning or worse; `level` is one of logging's levels."""
        self._logger.log(level, "%s", text)
        if level >= logging.WARNING:
            self.messages.add(text)


class FmuLog(ComponentLog):
    """Log of an FMU in this process, which writes through a callback; the level follows the FMI status (OK is debug).

    Args:
        component: Name of the component.
        names: Variable names by the form used in messages: "r12" for "#r12#".
        folder: Folder in which the FMU is unpacked; a library that this log needs is copied there.
    """

    def __init__(self, component: str, names: Mapping[str, str], folder: Path) -> None:
        super().__init__(component)
        self.errors = 0
        self._names = names
        self._formatter = _load_formatter(folder)
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self._entry = fmi2.fmi2CallbackLoggerTYPE(lambda _, __, status, ___, text: self.take(status, text))
        self.callbacks.logger = self._entry
        if self._formatter is not None:
            self._formatter.addLoggerProxy(ctypes.byref(self.callbacks))

    def close(self) -> None:
        """Unload the formatting library; the FMU must not write any more."""
        formatter, self._formatter = self._formatter, None
        if formatter is not None:
            fmpy.freeLibrary(formatter._handle)

    def take(self, status: int, message: Any) -> None:
        """Write a message of the FMU."""
        raw = message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)
        text = _VARIABLE.sub(self._name, raw).strip()
        if 0 <= status < len(LEVELS):
            self.write(LEVELS[status], text)
        else:
            self._logger.error("%s", text)
        self.errors += status in (ERROR, FATAL)

    def _name(self, reference: re.Match[str]) -> str:
        return "#" if reference[1] is None else self._names.get(reference[1], reference[0])


def _load_formatter(folder: Path) -> Any:
    """Load a copy of fmpy's library that fills in printf formats, which ctypes cannot; None if it is missing.

    The library serves one callback at a time for all its users, so each log has its own copy.
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


# ---- Texts for failed FMI calls -------------------------------------------------------------------------------------

_NAMES = {DISCARD: "Discard", ERROR: "Error", FATAL: "Fatal", PENDING: "Pending"}

#: Advice by status.
ADVICE = {
    ERROR: "its inputs may be out of its range or the coupling step too large for it; it can be started again",
    FATAL: "it is not called again in this process; load it again for another run, and report the fault to its maker",
    PENDING: (
        "it steps in the background (canRunAsynchronuously), and this master waits for each step: ask its maker for "
        "an FMU that completes a step before doStep returns"
    ),
}
_INPUTS_SHOWN = 12


def returned(status: int, function: str = "it", version: int = 2) -> str:
    """Return a sentence that describes a status of this version of FMI."""
    is_status = status in _NAMES and (version == 2 or status != PENDING)
    what = f"fmi{version}{_NAMES[status]}" if is_status else f"{status}, which is no status of FMI"
    return f"{function} returned {what}."


def _input_text(inputs: Mapping[str, float], variables: Mapping[str, Variable]) -> str:
    shown = []
    for name, value in inputs.items():
        unit = variables[name].unit if name in variables else None
        shown.append(f"{name} = {value:g}" + ("" if unit is None or unit.name in ("", "1") else f" {unit.name}"))
    more = f" and {len(shown) - _INPUTS_SHOWN} more" if len(shown) > _INPUTS_SHOWN else ""
    return f"Its inputs: {', '.join(shown[:_INPUTS_SHOWN])}{more}."


# ---- Common part of components that are FMUs, in this process or another --------------------------------------------


class OpenedFmu:
    """File of an FMU, the state of its run, and the error report of a failed call."""

    def __init__(self, fmu: FmuFile, name: str, messages: Messages) -> None:
        self._fmu, self._name, self._messages = fmu, name, messages
        self.validity: Validity | None = fmu.validity  #: Range of validity of its model; None if the FMU has none.
        self._inputs: dict[str, float] = {}
        self._time = 0.0
        self._changed: dict[str, None] = {}

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""
        return self._fmu.variables

    @property
    def capabilities(self) -> Capabilities:
        """Abilities declared in modelDescription.xml."""
        return self._fmu.capabilities

    @property
    def is_ours(self) -> bool:
        """Whether this project built the FMU, so that the state it keeps from run to run is known."""
        return self._fmu.is_ours

    @property
    def identity(self) -> str:
        """GUID of the FMU."""
        return self._fmu.description.guid

    @property
    def source(self) -> str:
        """File name of the FMU."""
        return self._fmu.path.name

    @property
    def messages(self) -> tuple[str, ...]:
        """Conditions of its results, changes to shared state, and its warnings and errors since it began, each once."""
        return (*self._fmu.conditions, *self._changed, *self._messages.all)

    def _stand(self, time: float, inputs: Mapping[str, float]) -> None:
        """Record the state of the run: the time [s], and inputs in their own units."""
        self._time, self._inputs = time, dict(inputs)

    def _check_state(self) -> None:
        if not self.capabilities.state:
            raise StepError(
                f"component {self._name!r} ({self.source}) cannot save its state (canGetAndSetFMUstate is false in "
                "its model description); use an algorithm that repeats no step"
            )

    def _unknown_state(self) -> StepError:
        return StepError(
            f"component {self._name!r} ({self.source}) does not know this state: it belongs to another component, to a "
            "run that has ended, or has been freed; save a state in this run"
        )

    def _not_begun(self) -> StepError:
        return StepError(f"component {self._name!r} ({self.source}) is not running; call begin() first")

    def _failure(self, failed: str, why: str, to_do: str = "") -> StepError:
        when = "" if " from " in failed else f" at {self._time:g} s"
        parts = [
            f"component {self._name!r} ({self.source}) {failed}{when}: {why}",
            f"Last messages: {self._messages.last.rstrip('.')}.",
        ]
        parts += [_input_text(self._inputs, self.variables)] if self._inputs else []
        parts += [f"What to do: {to_do}"] if to_do else []
        return StepError(" ".join(parts))


# ==== Checks that an FMU leaves the process as it was, and the record of the FMU that is being called ================


# ---- Process state that an FMU may change for all components --------------------------------------------------------

#: Control bits of fenv_t by system and processor, in words of 64 bits: the settings, without the status flags.
_CONTROL: dict[tuple[str, str], tuple[int, ...]] = {
    ("linux", "x86_64"): (0xFFFF, 0, 0, 0xFFC0 << 32),
    ("darwin", "x86_64"): (0xFFFF | 0xFFC0 << 32, 0),
    ("linux", "aarch64"): (0xFFFFFFFF,),
    ("darwin", "arm64"): (0, 0xFFFFFFFF),
}


@dataclass(frozen=True)
class Surroundings:
    """Shared state of the process at one moment."""

    folder: str  #: Working directory of the process; empty if there was none.
    floating: Any  #: Floating-point environment of the process, fenv_t; None if it cannot be read on this platform.

    @classmethod
    def now(cls) -> Surroundings:
        """Return the current state, in this thread."""
        return cls(_folder(), _floating())

    def restore(self) -> tuple[str, ...]:
        """Restore this state; return descriptions of what had changed."""
        return tuple(self._changes())

    def _changes(self) -> Iterator[str]:
        if self.folder and (found := _folder()) != self.folder:
            os.chdir(self.folder)
            yield f"the working directory (to {found or 'one that no longer exists'})"
        now = _floating()
        if now is not None and self.floating is not None and _control(now) != _control(self.floating):
            _mathematics().fesetenv(self.floating)
            yield "the floating-point environment (the rounding mode, or small numbers flushed to 0)"


def _folder() -> str:
    with suppress(OSError):
        return str(os.getcwd())  # noqa: PTH109 -- Path.cwd() takes five times as long, and this is called often
    return ""


def _floating() -> Any:
    library = _mathematics()
    if library is None:
        return None
    environment = (ctypes.c_uint64 * 8)()
    return environment if library.fegetenv(environment) == 0 else None


def _control(environment: Any) -> int:
    return int.from_bytes(environment, "little") & _mask()


@cache
def _mask() -> int:
    words = _CONTROL.get((sys.platform, platform.machine()), ())
    return sum(word << 64 * place for place, word in enumerate(words))


@cache
def _mathematics() -> Any:
    """Return the C library's mathematics; None if its layout of the environment is not known."""
    if not _mask():
        return None
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(ctypes.util.find_library("m") or "libm.so.6")
        return library if library.fegetenv and library.fesetenv else None
    return None


# ---- Record of the FMU that is being called, so that one that ends this process or never returns can be named --------

#: Thread whose run is watched; 0 if none is.
_thread = 0


def calling(component: str, what: str) -> AbstractContextManager[None]:
    """Return a context that records a call of a component; `what` completes "it was called to ..."."""
    record = _record()
    return nullcontext() if record is None else record.calling(component, what)


def calling_loop() -> AbstractContextManager[None]:
    """Return a context that records that the loop of a watched run calls; the loop itself records which part."""
    record = _record() if _thread else None
    return nullcontext() if record is None else record.calling_loop()


@contextmanager
def watching(names: Sequence[str]) -> Iterator[None]:
    """Watch a run; only one thread's run is watched at a time.

    Args:
        names: Display names of the components, in the order of the loop's numbers.
    """
    global _thread  # noqa: PLW0603 -- one record per process
    record = _record()
    if record is None or _thread:
        yield
        return
    record.name_parts(names)
    _thread = threading.get_ident()
    try:
        yield
    finally:
        _thread = 0


def loop_words() -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Return the memory in which the loop records its calls and its time; None if this run is not watched."""
    record = _record() if _thread else None
    if record is None:
        return None
    words = np.frombuffer(record.memory, np.int64, 2, record.calls)
    return words, np.frombuffer(record.memory, np.float64, 1, record.clock)


def _record() -> Record | None:
    """Return the record of this process; None in a worker, and while another thread's run is watched.

    The first call in a user's program starts the process that reads it.
    """
    if _thread not in (0, threading.get_ident()) or supervision.is_worker:
        return None
    if supervision.record is None or supervision.record.owner != os.getpid():
        supervision.record = _ReadByProcess()
    return supervision.record


class _ReadByProcess(Record):
    """Record of a user's program: a file, the process that reads it, and a function that the C library calls on exit().

    A command needs none of this: its parent reads its record.
    """

    def __init__(self) -> None:
        number, name = tempfile.mkstemp(prefix="fmu_called_")
        os.ftruncate(number, SIZE)
        super().__init__(mmap.mmap(number, SIZE))
        os.close(number)
        command = [sys.executable, "-I", "-S", str(supervision.__file__), name]
        self._reader = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)
        self._exit = _ExitNotice(self)
        atexit.register(self.close)

    def close(self) -> None:
        """End the other process, which removes the file; for a normal end of the interpreter."""
        if os.getpid() != self.owner:
            return
        self._exit.cancel()
        if self._reader.stdin is not None:
            self._reader.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._reader.wait(3.0)


class _ExitNotice:
    """Function that the C library calls on exit(), until it is cancelled before Python's own end.

    It uses the C++ ABI for libraries that are unloaded. Outside glibc and macOS the cancellation is not available, and
    nothing is registered.
    """

    def __init__(self, record: Record) -> None:
        self._record, self._armed = record, True
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(self._on_exit)
        self._key = ctypes.create_string_buffer(1)
        self._library: Any = None
        if sys.platform == "darwin" or (sys.platform == "linux" and _is_glibc()):
            self._library = ctypes.CDLL(None)
            key = ctypes.cast(self._key, ctypes.c_void_p)
            getattr(self._library, "__cxa_atexit")(self._call, None, key)

    def cancel(self) -> None:
        """Remove the function from the C library's list."""
        self._armed = False
        if self._library is not None:
            getattr(self._library, "__cxa_finalize")(ctypes.cast(self._key, ctypes.c_void_p))

    def _on_exit(self, _nothing: Any) -> None:
        if not self._armed or os.getpid() != self._record.owner or not self._record.is_calling:
            return
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        os._exit(1)  # the other process names the FMU


def _is_glibc() -> bool:
    if sys.platform == "win32":
        return False
    else:
        with suppress(ValueError, OSError, AttributeError):
            return bool(os.confstr("CS_GNU_LIBC_VERSION"))
        return False
