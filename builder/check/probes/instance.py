"""One instance and the calls of a host; calls return their status, and only `need` and similar methods raise."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_uint64, c_void_p
from dataclasses import dataclass
from typing import Any

from builder.check.probes.library import (
    CO_SIMULATION,
    DISCARD,
    STATUS_NAMES,
    TERMINATED,
    WARNING,
    Callbacks,
    Library,
    Logger,
    MissingFunctionError,
    memory_functions,
)
from eightpost.fmi.description import Variable

Value = float | int | bool | str
C_TYPES: dict[str, Any] = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_char_p}


class CallError(Exception):
    """A call failed that had to succeed; the message contains its name, its status and the last log message."""


class TerminatedError(CallError):
    """The FMU has ended the simulation, which is allowed: a step returned fmi2Discard and the status is terminated."""


@dataclass(frozen=True)
class Message:
    """One log message."""

    status: int
    text: bytes


@dataclass(frozen=True)
class Birth:
    """Arguments of fmi2Instantiate; `kind` is fmi2Type."""

    guid: str
    resources: str
    logging: bool = False
    kind: int = CO_SIMULATION


def base_type(variable: Variable) -> str:
    """Return the type of the functions that set and read a variable."""
    return "Integer" if variable.type == "Enumeration" else variable.type


def _c_type(variable: Variable) -> Any:
    """Return the type of C that holds any value of a variable; FMI 3.0 has integers of 64 bits."""
    if base_type(variable) != "Integer" or not variable.native:
        return C_TYPES[base_type(variable)]
    return c_uint64 if variable.native.startswith("U") else c_int64


def refused(status: int) -> bool:
    """Return whether a status rejects a call: fmi2Discard, fmi2Error, fmi2Fatal."""
    return status >= DISCARD


class Instance:
    """An instance of an FMU; `address` is None if fmi2Instantiate returned NULL."""

    def __init__(self, library: Library, birth: Birth) -> None:
        self.library = library
        self.messages: list[Message] = []
        self._logger = Logger(self._log)
        self._callbacks = Callbacks(self._logger, *memory_functions(), None, None)
        function = library.function("Instantiate")
        library.begin("fmi2Instantiate")
        self.address: int | None = function(
            b"probe", birth.kind, birth.guid.encode(), birth.resources.encode(),
            ctypes.byref(self._callbacks), 0, int(birth.logging),
        )  # fmt: skip

    def _log(self, _environment: int, _name: bytes, status: int, category: bytes, text: bytes) -> None:
        self.messages.append(Message(status, text or b""))
        self.library.categories.add(category or b"")

    def last_message(self) -> str:
        """Return the last logged warning or error as text to append to a message."""
        found = [m for m in self.messages if m.status >= WARNING]
        return f": {found[-1].text.decode('utf-8', 'replace').strip()[:300]}" if found else ""

    def call(self, name: str, *arguments: Any, note: str = "") -> int:
        """Call fmi2<name> with this instance as first argument."""
        return self.library.call(name, self.address, *arguments, note=note)

    def need(self, name: str, *arguments: Any, note: str = "") -> None:
        """Call a function that must succeed.

        Raises:
            CallError: The call failed.
        """
        status = self.call(name, *arguments, note=note)
        if refused(status):
            raise CallError(f"fmi2{name}{note} returned {status_name(status)}{self.last_message()}")

    def free(self) -> None:
        """Free the instance."""
        if self.address is not None:
            self.library.begin("fmi2FreeInstance")
            self.library.function("FreeInstance")(self.address)
            self.address = None

    def set(self, variable: Variable, value: Value) -> int:
        """Set one variable."""
        kind = base_type(variable)
        content = value.encode() if isinstance(value, str) else value
        buffer = (_c_type(variable) * 1)(content)
        return self.call(f"Set{kind}", _references([variable]), 1, buffer, note=f" of {variable.name} to {value}")

    def get(self, variable: Variable) -> tuple[int, Value]:
        """Get one variable."""
        kind = base_type(variable)
        buffer = (_c_type(variable) * 1)()
        status = self.call(f"Get{kind}", _references([variable]), 1, buffer, note=f" of {variable.name}")
        value = buffer[0]
        return status, (value or b"").decode("utf-8", "replace") if kind == "String" else value

    def set_reals(self, variables: Sequence[Variable], values: Sequence[float]) -> int:
        """Set Reals together."""
        if not variables:
            return 0
        return self.call("SetReal", _references(variables), len(variables), (c_double * len(variables))(*values))

    def get_reals(self, variables: Sequence[Variable]) -> tuple[int, list[float]]:
        """Get Reals together."""
        if not variables:
            return 0, []
        buffer = (c_double * len(variables))()
        status = self.call("GetReal", _references(variables), len(variables), buffer)
        return status, list(buffer)

    def reals(self, variables: Sequence[Variable]) -> list[float]:
        """Get Reals, which must succeed.

        Raises:
            CallError: The call failed.
        """
        status, values = self.get_reals(variables)
        if refused(status):
            raise CallError(f"fmi2GetReal returned {status_name(status)}{self.last_message()}")
        return values

    def step(self, time: float, h: float) -> int:
        """Do a step, after which earlier states will not be restored (noSetFMUStatePriorToCurrentPoint)."""
        return self.call("DoStep", time, h, 1, note=f" from {time!r} by {h!r} s")

    def has_terminated(self) -> bool:
        """Return whether the step that returned fmi2Discard has ended the simulation (fmi2Terminated)."""
        value = c_int()
        try:
            status = self.call("GetBooleanStatus", TERMINATED, ctypes.byref(value))
        except MissingFunctionError:
            return False
        return not refused(status) and bool(value.value)

    def state(self) -> c_void_p:
        """Get a new FMU state, which must succeed."""
        state = c_void_p()
        self.need("GetFMUstate", ctypes.byref(state))
        return state

    def serialized(self, state: c_void_p) -> bytes:
        """Return the bytes of an FMU state, which must succeed."""
        size = c_size_t()
        self.need("SerializedFMUstateSize", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.need("SerializeFMUstate", state, buffer, size.value)
        return bytes(buffer.raw)

    def deserialize(self, content: bytes) -> tuple[int, c_void_p]:
        """Return the status and the deserialized state."""
        state = c_void_p()
        return self.call("DeSerializeFMUstate", content, len(content), ctypes.byref(state)), state

    def directional(self, unknown: Variable, known: Variable) -> tuple[int, float]:
        """Return the status and d unknown / d known."""
        result = (c_double * 1)()
        status = self.call(
            "GetDirectionalDerivative", _references([unknown]), 1, _references([known]), 1, (c_double * 1)(1.0), result,
            note=f" of {unknown.name} by {known.name}",
        )  # fmt: skip
        return status, result[0]

    def set_derivatives(self, variables: Sequence[Variable], slopes: Sequence[float]) -> int:
        """Set first derivatives of inputs."""
        count = len(variables)
        orders = (c_int * count)(*[1] * count)
        return self.call("SetRealInputDerivatives", _references(variables), count, orders, (c_double * count)(*slopes))

    def output_derivatives(self, variables: Sequence[Variable], order: int) -> tuple[int, list[float]]:
        """Return the status and the output derivatives of an order."""
        count = len(variables)
        values = (c_double * count)()
        orders = (c_int * count)(*[order] * count)
        note = f" of order {order}"
        status = self.call("GetRealOutputDerivatives", _references(variables), count, orders, values, note=note)
        return status, list(values)


def _references(variables: Sequence[Variable]) -> Any:
    return (c_uint * len(variables))(*(int(variable.reference) for variable in variables))


def status_name(status: int) -> str:
    """Return the name of a status."""
    return STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else f"the unknown status {status}"
