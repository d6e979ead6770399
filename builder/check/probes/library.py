"""The C functions of an FMU, with argument types and a record of the last call."""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import shutil
import sys
import tempfile
from ctypes import c_char_p, c_double, c_int, c_void_p
from pathlib import Path
from typing import Any, Final

from eightpost.fmi.functions import FUNCTIONS

WARNING: Final = 1
DISCARD: Final = 2
ERROR: Final = 3
FATAL: Final = 4
#: fmi2Type.
MODEL_EXCHANGE: Final = 0
CO_SIMULATION: Final = 1
#: fmi2StatusKind.
TERMINATED: Final = 3
#: Recorded name of the only call with NULL that the standard allows.
FREEING_NOTHING: Final = "fmi2FreeInstance(NULL)"
STATUS_NAMES: Final = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")

Logger = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)


class Callbacks(ctypes.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = (
        ("logger", Logger),
        ("allocateMemory", c_void_p),
        ("freeMemory", c_void_p),
        ("stepFinished", c_void_p),
        ("componentEnvironment", c_void_p),
    )


class EventInfo(ctypes.Structure):
    """fmi2EventInfo."""

    _fields_ = (
        ("newDiscreteStatesNeeded", c_int),
        ("terminateSimulation", c_int),
        ("nominalsOfContinuousStatesChanged", c_int),
        ("valuesOfContinuousStatesChanged", c_int),
        ("nextEventTimeDefined", c_int),
        ("nextEventTime", c_double),
    )


class MissingFunctionError(Exception):
    """The binary does not export a function."""


class Library:
    """A loaded binary.

    `call` writes the name of the function into the file `progress` first, so that it is known after a crash.
    `categories` are the log categories that its instances have used.
    """

    version = 2  #: Version of FMI.

    def __init__(self, path: Path, progress: Path) -> None:
        self.path, self.progress = path, progress
        self.categories: set[bytes] = set()
        with progress.open("r+b") as stream:
            stream.write(bytes(512))
            stream.flush()
            self._progress = mmap.mmap(stream.fileno(), 512)
        self._functions: dict[str, Any] = {}
        self.begin(f"loading {path.name}")
        self._library = ctypes.CDLL(str(path), mode=getattr(os, "RTLD_NOW", 0) | getattr(os, "RTLD_LOCAL", 0))

    def again(self) -> Library:
        """Load a copy of the binary with separate static memory."""
        folder = tempfile.mkdtemp(prefix="eightpost_binary_", dir=self.path.parent)
        copy = self._copied(Path(shutil.copy2(self.path, folder)))
        copy.path, copy.categories = self.path, self.categories
        shutil.rmtree(folder, ignore_errors=True)  # on systems that can remove a loaded file, at most one copy remains
        return copy

    def _copied(self, path: Path) -> Library:
        return Library(path, self.progress)

    def begin(self, call: str) -> None:
        """Record the name of a call before it is made."""
        text = call.encode()[:500]
        self._progress[: len(text) + 1] = text + b"\0"

    def call(self, name: str, *arguments: Any, note: str = "") -> int:
        """Call fmi2<name>; return its status.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        function = self.function(name)
        self.begin(f"fmi2{name}{note}")
        return int(function(*arguments) or 0)

    def function(self, name: str) -> Any:
        """Return fmi2<name>.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        return self.native(name)

    def native(self, name: str) -> Any:
        """Return the function of the binary's own version of FMI, with the types of its arguments and of its result.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        if name not in self._functions:
            in_c, types = f"fmi{self.version}{name}", FUNCTIONS[self.version][name]
            try:
                function = getattr(self._library, in_c)
            except AttributeError:
                raise MissingFunctionError(f"{in_c} is not exported") from None
            function.argtypes, function.restype = types.arguments, types.result
            self._functions[name] = function
        return self._functions[name]


def memory_functions() -> tuple[int | None, int | None]:
    """Return the addresses of calloc and free of the C library."""
    c = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
    calloc, free = (ctypes.cast(function, c_void_p).value for function in (c.calloc, c.free))
    return calloc, free


def binary_path(folder: Path, identifier: str, fmi: int) -> Path | None:
    """Return the binary for this platform in an unpacked FMU of an FMI version, 2 or 3.

    None if it does not exist, or if the identifier could name a file outside the FMU.
    """
    if not identifier.isidentifier():
        return None
    paths = (folder / name for name in binary_members(identifier, fmi))
    return next((path for path in paths if path.is_file()), None)


def binary_members(identifier: str, fmi: int) -> tuple[str, ...]:
    """Return the possible names of a binary for this platform in an archive of an FMI version, 2 or 3."""
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    return tuple(f"binaries/{name}/{identifier}{suffix}" for name in platform_folders(fmi))


def platform_folders(fmi: int) -> tuple[str, ...]:
    """Return the folders of binaries/ for this platform: in FMI 2.0 its own name, then that of FMI 3.0."""
    system = {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux")
    machine = "aarch64" if platform.machine().lower() in ("arm64", "aarch64") else "x86_64"
    bits = "64" if sys.maxsize > 2**32 else "32"
    tuple_name = f"{machine}-{ {'win': 'windows'}.get(system, system) }"
    own = (f"{system}{bits}",) if machine == "x86_64" or system == "darwin" else ()
    return (tuple_name,) if fmi == 3 else (*own, tuple_name)
