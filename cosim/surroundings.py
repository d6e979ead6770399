"""Process state that an FMU may change for all components: the working directory and the floating-point environment.

A changed working directory puts files elsewhere. A changed rounding mode, or flushing of small numbers to 0, changes
the results of all components; libraries built with -ffast-math enable such flushing when they are loaded.
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

    Args:
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
