"""Checks that an FMU leaves the process as it was, and the record of the FMU that is being called."""

from __future__ import annotations

import atexit
import ctypes
import ctypes.util
import mmap
import os
import platform
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.workers import supervision
from eightpost.workers.supervision import SIZE, Record

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
