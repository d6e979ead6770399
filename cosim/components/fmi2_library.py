"""Library of an FMI 2.0 FMU as ctypes loads it; it may lack functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_FMI_ERROR = 3


class MissingFunction:
    """Stand-in for a function that the library lacks: it returns fmi2Error."""

    def __call__(self, *_arguments: Any) -> int:
        """Return fmi2Error."""
        return _FMI_ERROR


class Fmi2Library:
    """Library in which a missing function returns fmi2Error.

    Sources for static linking prefix each name with the model's identifier (FMI 2.0.4, 2.1.1).

    Args:
        dll: Library as ctypes loads it.
        identifier: Name of the library (modelIdentifier).
    """

    def __init__(self, dll: Any, identifier: str) -> None:
        self._dll, self._identifier = dll, identifier

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("fmi2"):
            return getattr(self._dll, name)
        plain = getattr(self._dll, name, None)
        return plain or getattr(self._dll, f"{self._identifier}_{name}", None) or MissingFunction()

    def missing(self, functions: Sequence[str]) -> list[str]:
        """Return the names in C of those functions that the library lacks.

        Args:
            functions: Names without prefix: "DoStep".
        """
        return [f"fmi2{name}" for name in functions if isinstance(getattr(self, f"fmi2{name}"), MissingFunction)]
