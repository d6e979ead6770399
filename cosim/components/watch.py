"""Checks that an FMU leaves the process as it was: working directory, locale, rounding mode."""

from __future__ import annotations

import atexit
import contextlib
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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

# ---- Process state that an FMU may change for all components --------------------------------------------------------

_Words = tuple[int, ...]

#: Control bits of fenv_t by system and processor, in words of 64 bits: the settings, without the status flags.
_CONTROL: dict[tuple[str, str], _Words] = {
    ("linux", "x86_64"): (0xFFFF, 0, 0, 0xFFC0 << 32),
    ("darwin", "x86_64"): (0xFFFF | 0xFFC0 << 32, 0),
    ("linux", "aarch64"): (0xFFFFFFFF,),
    ("darwin", "arm64"): (0, 0xFFFFFFFF),
}


@dataclass(frozen=True)
class Surroundings:
    """Shared state of the process at one moment.

    Attributes:
        folder: Working directory of the process; empty if there was none.
        floating: Floating-point environment of the process, fenv_t; None if it cannot be read on this platform.
    """

    folder: str
    floating: Any

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


def _control(environment: Any) -> _Words:
    return tuple(word & mask for word, mask in zip(environment, _mask(), strict=False))


@cache
def _mask() -> _Words:
    return _CONTROL.get((sys.platform, platform.machine()), ())


@cache
def _mathematics() -> Any:
    """Return the C library's mathematics; None if its layout of the environment is not known."""
    if not _mask():
        return None
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(ctypes.util.find_library("m") or "libm.so.6")
        return library if library.fegetenv and library.fesetenv else None
    return None


# ---- Record of the FMU that is being called, so that one that ends this process (exit, a signal, --------------------

#: Layout of the file: words of 64 bits, then names, one per line. Word 0 is the kind of caller, word 1 the component.
_SIZE, _NAMES = 1 << 16, 128
_NOBODY, _PYTHON, _LOOP = 0, 1, 2
#: Words of the loop (cosim.engine.plan.Memory.failure); the second is the number of the part that it calls.
_FAILURE, _FAILURE_SIZE = 4, 4

_MESSAGE = (
    "error: this process ended while component {} was called: the FMU crashed or called exit(), and there is no "
    "result. Run it in its own process, where this is a failed step: --isolate, or IsolatedComponent "
    "(docs/how_to/foreign_fmus.md)"
)

_WATCHER = f"""
import os, signal, struct, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.stdin.buffer.read()
with open(sys.argv[1], "rb") as file:
    content = file.read()
os.unlink(sys.argv[1])
words = struct.unpack_from("8q", content)
if words[0]:
    names = content[{_NAMES}:].split(b"\\0")[0].decode("utf-8", "replace").splitlines()
    place = words[1] if words[0] == {_PYTHON} else words[{_FAILURE + 1}]
    print({_MESSAGE!r}.format(names[place] if 0 <= place < len(names) else "unknown"), file=sys.stderr)
"""


class _Record:
    """The file, the process that reads it, and the function that the C library calls on exit()."""

    def __init__(self) -> None:
        number, name = tempfile.mkstemp(prefix="fmu_called_")
        os.ftruncate(number, _SIZE)
        self._memory = mmap.mmap(number, _SIZE)
        os.close(number)
        self.words: NDArray[np.int64] = np.frombuffer(self._memory, np.int64, _NAMES // 8)
        self.owner = os.getpid()
        self._watcher = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _WATCHER, name], stdin=subprocess.PIPE, start_new_session=True
        )
        self._exit = _ExitNotice(self)
        atexit.register(self.close)

    def name(self, names: Sequence[str]) -> None:
        """Write the names of the components; numbers in `words` are indices into them."""
        text = "\n".join(names).encode()[: _SIZE - _NAMES - 1] + b"\0"
        self._memory[_NAMES : _NAMES + len(text)] = text

    def called(self) -> str:
        """Return the name of the component that is being called; empty if none is."""
        who = int(self.words[0])
        if who == _NOBODY:
            return ""
        place = int(self.words[1] if who == _PYTHON else self.words[_FAILURE + 1])
        names = self._memory[_NAMES:].split(b"\0")[0].decode("utf-8", "replace").splitlines()
        return names[place] if 0 <= place < len(names) else "unknown"

    def close(self) -> None:
        """End the other process, which removes the file; for a normal end of the interpreter."""
        if os.getpid() != self.owner:
            return
        self._exit.cancel()
        if self._watcher.stdin is not None:
            self._watcher.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._watcher.wait(3.0)


class _ExitNotice:
    """Function that the C library calls on exit(), until it is cancelled before Python's own end.

    It uses the C++ ABI for libraries that are unloaded. Outside glibc and macOS the cancellation is not available, and
    nothing is registered.
    """

    def __init__(self, record: _Record) -> None:
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
        if not self._armed or os.getpid() != self._record.owner or not (name := self._record.called()):
            return
        self._record.words[0] = _NOBODY
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.write(f"{_MESSAGE.format(name)}\n")
            sys.stderr.flush()
        os._exit(1)


class _Watching:
    """State of the watched run; only one run is watched at a time."""

    def __init__(self) -> None:
        self.record: _Record | None = None
        self.places: dict[str, int] = {}
        self.thread = 0

    @property
    def is_here(self) -> bool:
        """Whether this thread makes the watched run."""
        return bool(self.places) and self.thread == threading.get_ident()


_current = _Watching()


@contextmanager
def watching(names: Sequence[str], labels: Sequence[str]) -> Iterator[None]:
    """Watch a run.

    Args:
        names: Names of the components, in the order of the loop's numbers.
        labels: Display name of each component.
    """
    if _current.record is None or _current.record.owner != os.getpid():
        _current.record, _current.places = _Record(), {}
    if _current.places:  # another thread's run is watched
        yield
        return
    _current.record.name(labels)
    _current.places, _current.thread = {name: place for place, name in enumerate(names)}, threading.get_ident()
    try:
        yield
    finally:
        _current.record.words[0], _current.places = _NOBODY, {}


def loop_words() -> NDArray[np.int64] | None:
    """Return the memory in which the loop records the part that it calls; None if no run is watched."""
    if _current.record is None or not _current.is_here:
        return None
    return _current.record.words[_FAILURE : _FAILURE + _FAILURE_SIZE]


@contextmanager
def _written(who: int, place: int) -> Iterator[None]:
    record = _current.record
    if record is None or not _current.is_here:
        yield
        return
    before = int(record.words[0]), int(record.words[1])
    record.words[1], record.words[0] = place, who
    try:
        yield
    finally:
        record.words[1], record.words[0] = before[1], before[0]


@contextmanager
def calling(name: str) -> Iterator[None]:
    """Record that a component is being called."""
    if name not in _current.places:
        yield
        return
    with _written(_PYTHON, _current.places[name]):
        yield


#: Record that the loop runs; the loop itself records the part that it calls.
calling_loop = partial(_written, _LOOP, 0)


def _is_glibc() -> bool:
    if sys.platform == "win32":
        return False
    with contextlib.suppress(ValueError, OSError, AttributeError):
        return bool(os.confstr("CS_GNU_LIBC_VERSION"))
    return False
