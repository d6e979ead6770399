"""C functions of an FMI 3.0 library with their types, and their names for the functions of FMI 2.0."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

from cosim.components.fmi3_variables import Fmi3Table
from cosim.engine import blocks
from eightpost.fmi.names import function_name

P, B, N, R, INT, T = (
    ctypes.c_void_p, ctypes.c_bool, ctypes.c_size_t, ctypes.c_double, ctypes.c_int, ctypes.c_char_p,
)  # fmt: skip

#: C types of values, by FMI 3.0 type.
VALUES: Mapping[str, Any] = {
    "Float64": ctypes.c_double, "Float32": ctypes.c_float,
    "Int8": ctypes.c_int8, "UInt8": ctypes.c_uint8, "Int16": ctypes.c_int16, "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32, "UInt32": ctypes.c_uint32, "Int64": ctypes.c_int64, "UInt64": ctypes.c_uint64,
    "Boolean": ctypes.c_bool, "String": ctypes.c_char_p,
}  # fmt: skip
_EXCHANGE = (P, P, N, P, N)
_TYPES: Mapping[str, tuple[Any, ...]] = {
    **{f"{way}{kind}": _EXCHANGE for kind in VALUES for way in ("Set", "Get")},
    "SetDebugLogging": (P, B, N, P),
    "InstantiateCoSimulation": (T, T, T, B, B, B, B, P, N, P, P, P),
    "FreeInstance": (P,),
    "EnterInitializationMode": (P, B, R, R, B, R),
    "ExitInitializationMode": (P,),
    "Terminate": (P,),
    "Reset": (P,),
    "DoStep": (P, R, R, B, P, P, P, P),
    "GetFMUState": (P, P),
    "SetFMUState": (P, P),
    "FreeFMUState": (P, P),
    "SerializedFMUStateSize": (P, P, P),
    "SerializeFMUState": (P, P, P, N),
    "DeserializeFMUState": (P, P, N, P),
    "GetDirectionalDerivative": (P, P, N, P, N, P, N, P, N),
}
_RESULTS: Mapping[str, Any] = {"InstantiateCoSimulation": P, "FreeInstance": None}

ERROR = 3


def fmi3_name(function: str) -> str:
    """Return the name in FMI 3.0 of a function of FMI 2.0; an unknown text is returned unchanged."""
    if not function.startswith("fmi2"):
        return function
    plain = function.removeprefix("fmi2")
    # The host sets inputs in intermediate updates, so this is the function that failed.
    return "fmi3SetFloat64" if plain == "SetRealInputDerivatives" else f"fmi3{function_name(plain)}"


class Fmi3Functions:
    """Functions of a library, with their types; a missing one returns fmi3Error.

    Args:
        dll: Library as ctypes loads it.
        identifier: Name of the library (modelIdentifier), with which sources for static linking prefix each name.

    Attributes:
        called: Name of the function that was called last through `call`.
    """

    def __init__(self, dll: Any, identifier: str) -> None:
        self._dll, self._identifier = dll, identifier
        self._found: dict[str, Any] = {}
        self._refusing = blocks.EXCHANGE_SIZED(lambda *_: ERROR)
        self.called = ""

    def has(self, name: str) -> bool:
        """Return whether the library has a function, e.g. DoStep."""
        return self._find(name) is not None

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function, e.g. DoStep."""
        self.called = f"fmi3{name}"
        function = self._find(name)
        return ERROR if function is None else function(*arguments)

    def address(self, name: str) -> int:
        """Return the address of a function; if it is missing, that of one that returns fmi3Error."""
        return int(ctypes.cast(self._find(name) or self._refusing, P).value or 0)

    def missing(self, functions: Sequence[str], table: Fmi3Table) -> list[str]:
        """Return the names in C of those functions that the library lacks.

        Args:
            functions: Names in FMI 2.0 without prefix: "SetReal".
            table: Variables, for the types of real numbers.
        """
        needed: dict[str, None] = {}
        for name in functions:
            if name in ("SetReal", "GetReal"):
                kinds = {v.type for v in table.variables if v.is_real}
                needed |= dict.fromkeys(f"{name[:3]}{kind}" for kind in sorted(kinds))
            elif name != "SetRealInputDerivatives":
                needed[function_name(name)] = None
        return [f"fmi3{name}" for name in needed if not self.has(name)]

    def _find(self, name: str) -> Any:
        if name not in self._found:
            function = getattr(self._dll, f"fmi3{name}", None) or getattr(
                self._dll, f"{self._identifier}_fmi3{name}", None
            )
            if function is not None:
                function.argtypes, function.restype = _TYPES[name], _RESULTS.get(name, INT)
            self._found[name] = function
        return self._found[name]
