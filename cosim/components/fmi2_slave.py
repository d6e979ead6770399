"""Calls of an FMI 2.0 FMU for co-simulation through fmpy, and libraries that lack functions."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from fmpy import fmi2

from cosim.components.fmu_log import FmuLog
from cosim.components.functions import FUNCTIONS, address_of

_ERROR = 3
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3  # fmi2StatusKind


class MissingFunction:
    """Stand-in for a function that the library lacks: it returns an error."""

    def __call__(self, *_arguments: Any) -> int:
        """Return fmi2Error or fmi3Error."""
        return _ERROR


class Library:
    """Library in which a missing function returns an error.

    Sources for static linking prefix each name with the model's identifier (FMI 2.0.4, 2.1.1).

    Args:
        dll: Library as ctypes loads it.
        identifier: Name of the library (modelIdentifier).
    """

    def __init__(self, dll: Any, identifier: str) -> None:
        self._dll, self._identifier = dll, identifier

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("fmi"):
            return getattr(self._dll, name)
        plain = getattr(self._dll, name, None)
        return plain or getattr(self._dll, f"{self._identifier}_{name}", None) or MissingFunction()

    def has(self, name: str) -> bool:
        """Return whether it has a function, e.g. fmi2DoStep."""
        return not isinstance(getattr(self, name), MissingFunction)


class FMU2Elements(fmi2.FMU2Slave):  # type: ignore[misc]  # fmpy has no types; it finds the FMI version in the class name
    """Instance of an FMI 2.0 FMU.

    Args:
        library: Path of the library for this platform.
        options: Arguments of fmpy's class.
    """

    def __init__(self, library: str, **options: Any) -> None:
        super().__init__(libraryPath=library, **options)

    def _loadFunctions(self) -> None:  # noqa: N802
        self.dll: Library = Library(self.dll, self.modelIdentifier)
        super()._loadFunctions()

    def begin(self, log: FmuLog) -> None:
        """Instantiate, with all messages switched on."""
        self.instantiate(callbacks=log.callbacks, loggingOn=True)

    def missing(self, functions: Sequence[str]) -> list[str]:
        """Return the names in C of those functions that the library lacks, for names like DoStep."""
        return [f"fmi2{name}" for name in functions if not self.dll.has(f"fmi2{name}")]

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function that the loop also calls, e.g. DoStep.

        Raises:
            FMICallException: It returned a status above a warning.
        """
        self._call(f"fmi2{name}", self.component, *arguments)

    def set_values(self, kind: str, references: Any, values: Any) -> None:
        """Set variables of a type (Real, Integer, Boolean or String) to a C array of values."""
        self.call(f"Set{kind}", references, len(values), values)

    def get_values(self, kind: str, references: Any, values: Any) -> None:
        """Get variables of a type (Real, Integer or Boolean) into a C array."""
        self.call(f"Get{kind}", references, len(values), values)

    def addresses(self) -> tuple[int, dict[str, int]]:
        """Return the instance and the addresses of the functions for the loop; 0 for a missing one."""
        found = {name: f"fmi2{name}" for name in FUNCTIONS}
        addresses = {n: address_of(getattr(self.dll, in_c)) if self.dll.has(in_c) else 0 for n, in_c in found.items()}
        return int(getattr(self.component, "value", self.component) or 0), addresses

    def free_state(self, state: Any) -> int:
        """Free the state that a pointer refers to; return the status."""
        return int(self.dll.fmi2FreeFMUstate(self.component, state))

    def last_step(self) -> tuple[float, bool]:
        """Return the time that a discarded step reached [s], NaN if it is not known, and whether it ended the run."""
        reached, ended = ctypes.c_double(float("nan")), ctypes.c_int(0)
        with suppress(Exception):
            self.fmi2GetRealStatus(self.component, _LAST_SUCCESSFUL_TIME, ctypes.byref(reached))
        with suppress(Exception):
            self.fmi2GetBooleanStatus(self.component, _TERMINATED, ctypes.byref(ended))
        return reached.value, bool(ended.value)
