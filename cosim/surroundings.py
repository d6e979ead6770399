"""What an FMU shares with the whole process and may change: the working directory and the floating-point environment.

A changed working directory puts files elsewhere; a changed rounding mode, or numbers near 0 flushed to 0, changes the
results of all components. Libraries built with -ffast-math do the latter when they are loaded.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

_Words = tuple[int, ...]

#: By system and processor: bits of fenv_t, in words of 64 bits, that say how to compute, and not what has happened.
_CONTROL: dict[tuple[str, str], _Words] = {
    ("linux", "x86_64"): (0xFFFF, 0, 0, 0xFFC0 << 32),
    ("darwin", "x86_64"): (0xFFFF | 0xFFC0 << 32, 0),
    ("linux", "aarch64"): (0xFFFFFFFF,),
    ("darwin", "arm64"): (0, 0xFFFFFFFF),
}


@dataclass(frozen=True)
class Surroundings:
    """How a process was at one moment.

    Args:
        folder: Working directory of the process; empty where there was none.
        floating: Floating-point environment of the process, fenv_t; None where it cannot be read here.
    """

    folder: str
    floating: Any

    @classmethod
    def now(cls) -> Surroundings:
        """Return what is so now, in this thread."""
        return cls(_folder(), _floating())

    def restore(self) -> tuple[str, ...]:
        """Make all as it was; return what had changed, in words."""
        return tuple(self._changes())

    def _changes(self) -> Iterator[str]:
        if self.folder and (found := _folder()) != self.folder:
            os.chdir(self.folder)
            yield f"the working directory (to {found or 'one that is gone'})"
        now = _floating()
        if now is not None and self.floating is not None and _control(now) != _control(self.floating):
            _mathematics().fesetenv(self.floating)
            yield "how floating-point numbers are computed (the rounding mode, or numbers near 0 taken for 0)"


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
    """The C library's mathematics; None where it is not known how it keeps the environment."""
    if not _mask():
        return None
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(ctypes.util.find_library("m") or "libm.so.6")
        return library if library.fegetenv and library.fesetenv else None
    return None
