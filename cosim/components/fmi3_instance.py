"""One instance of an FMI 3.0 FMU, called as FMI 2.0 calls instances: value references are numbers of elements."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.components.fmi3_functions import ERROR, VALUES, Fmi3Functions
from cosim.components.fmi3_variables import TYPES, Fmi3Table, Fmi3Variable
from cosim.engine import fmi3_calls as calls
from cosim.engine.blocks import Block

OK, _WARNING, _DISCARD = 0, 1, 2
#: fmi2StatusKind: last successful time, terminated.
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3
_INTEGERS = (-(1 << 31), (1 << 31) - 1)


class Fmi3Instance:
    """Instance of an FMI 3.0 FMU; every method has the arguments of the FMI 2.0 function, addresses as integers.

    Args:
        functions: Functions of the library.
        table: Variables of the FMU.
        slack: Internal step that the FMU declares [s]; 0 if it declares none.
        log: Function that takes a status and a message.

    Attributes:
        content: Data for the calls of the loop.
        block: The same as a table with an address, which is the instance for all FMI 2.0 calls.
    """

    def __init__(
        self, functions: Fmi3Functions, table: Fmi3Table, slack: float, log: Callable[[int, str], None]
    ) -> None:
        self._functions, self._table, self._log = functions, table, log
        self._elements = tuple(table.elements)
        self.content = _adapter(functions, table, slack)
        self.block = Block(self.content)
        self._experiment: tuple[Any, ...] = (False, 0.0, 0.0, False, 0.0)
        self._values: dict[int, Any] = {}
        self._known: dict[int, int] = {}
        self._texts: list[bytes] = []
        self._put_start_values()

    @property
    def pointer(self) -> int:
        """Pointer that the FMU returned."""
        return int(self.content.instance[0])

    @pointer.setter
    def pointer(self, value: int) -> None:
        self.content.instance[0] = value

    def set_debug_logging(self, on: int, count: int, categories: int) -> int:
        """Switch the log on or off, for the given categories."""
        return self._call("SetDebugLogging", bool(on), count, categories)

    def setup_experiment(self, has_tolerance: int, tolerance: float, start: float, has_stop: int, stop: float) -> int:
        """Store the arguments for `enter_initialization`."""
        self._experiment = bool(has_tolerance), tolerance, start, bool(has_stop), stop
        return OK

    def enter_initialization(self) -> int:
        """Enter initialization mode with the stored tolerance and times."""
        return self._call("EnterInitializationMode", *self._experiment)

    def exit_initialization(self) -> int:
        """Leave initialization mode."""
        return self._call("ExitInitializationMode")

    def terminate(self) -> int:
        """Terminate."""
        return self._call("Terminate")

    def reset(self) -> int:
        """Reset the instance, and the kept values of arrays with it."""
        self._put_start_values()
        return self._call("Reset")

    def free_state(self, state: int) -> int:
        """Free a state."""
        return self._call("FreeFMUState", state)

    def serialized_size(self, state: int, size: int) -> int:
        """Write the size of a state in bytes."""
        return self._call("SerializedFMUStateSize", state, size)

    def serialize(self, state: int, content: int, size: int) -> int:
        """Write a state as bytes."""
        return self._call("SerializeFMUState", state, content, size)

    def deserialize(self, content: int, size: int, state: int) -> int:
        """Make a state of bytes."""
        return self._call("DeserializeFMUState", content, size, state)

    def real_status(self, kind: int, value: int) -> int:
        """Write the time that the last step reached."""
        if kind != _LAST_SUCCESSFUL_TIME:
            return _DISCARD
        ctypes.c_double.from_address(value).value = self.content.clock[calls.REACHED]
        return OK

    def boolean_status(self, kind: int, value: int) -> int:
        """Write whether the FMU ended the simulation in the last step."""
        if kind != _TERMINATED:
            return _DISCARD
        ctypes.c_int.from_address(value).value = int(self.content.counts[calls.ENDED])
        return OK

    def set_integer(self, references: int, count: int, values: int) -> int:
        """Set Integer and Enumeration variables."""
        numbers = (ctypes.c_int * count).from_address(values)
        return self._set(references, list(numbers), ("Integer", "Enumeration"))

    def set_boolean(self, references: int, count: int, values: int) -> int:
        """Set Boolean variables."""
        numbers = (ctypes.c_int * count).from_address(values)
        return self._set(references, [bool(number) for number in numbers], ("Boolean",))

    def set_string(self, references: int, count: int, values: int) -> int:
        """Set String variables."""
        return self._set(references, list((ctypes.c_char_p * count).from_address(values)), ("String",))

    def get_integer(self, references: int, count: int, values: int) -> int:
        """Get Integer and Enumeration variables; a number beyond 32 bits is refused."""
        into = (ctypes.c_int * count).from_address(values)

        def put(k: int, value: int, name: str) -> int:
            if not _INTEGERS[0] <= value <= _INTEGERS[1]:
                text = f"{name} = {value} does not fit into 32 bits, which this program uses for integers"
                return self._refuse("GetInt64", text)
            into[k] = value
            return OK

        return self._get(references, count, ("Integer", "Enumeration"), put)

    def get_boolean(self, references: int, count: int, values: int) -> int:
        """Get Boolean variables."""
        into = (ctypes.c_int * count).from_address(values)

        def put(k: int, value: bool, _name: str) -> int:
            into[k] = int(value)
            return OK

        return self._get(references, count, ("Boolean",), put)

    def get_string(self, references: int, count: int, values: int) -> int:
        """Get String variables; the texts are valid until the next call."""
        into, self._texts = (ctypes.c_char_p * count).from_address(values), []

        def put(k: int, value: bytes | None, _name: str) -> int:
            self._texts.append(bytes(value or b""))
            into[k] = self._texts[-1]
            return OK

        return self._get(references, count, ("String",), put)

    def _call(self, name: str, *arguments: Any) -> int:
        return int(self._functions.call(name, self.pointer, *arguments))

    def _refuse(self, function: str, text: str) -> int:
        """Refuse a call in place of the FMU's function."""
        self._functions.called = f"fmi3{function}"
        self._log(ERROR, text)
        return ERROR

    def _put_start_values(self) -> None:
        """Make the kept values the start values, which an instance has at first and after a reset."""
        content, restored = self.content, int(self.content.counts[calls.RESTORED])
        calls.clear_ramps(content)
        content.known[:] = content.last_known[:] = restored
        self._known = dict.fromkeys(range(len(self._table.variables)), restored)
        self._values.clear()
        for e, (v, place) in enumerate(self._elements):
            variable = self._table.variables[v]
            if variable.is_real:
                kept = content.doubles if variable.type == "Float64" else content.singles
                content.last[e] = kept[content.begin[v] + place] = float(variable.start_of(place) or 0.0)

    def _kept(self, v: int) -> Any:
        """Return the kept values of a variable that is not real, at first its start values."""
        if v not in self._values:
            variable = self._table.variables[v]
            array = (VALUES[_value_type(variable)] * variable.size)()
            for place in range(variable.size):
                array[place] = _start(variable, place)
            self._values[v] = array
        return self._values[v]

    def _exchange(self, way: str, v: int) -> int:
        variable, kept = self._table.variables[v], self._kept(v)
        reference = (ctypes.c_uint32 * 1)(variable.reference)
        if way == "Get":
            self._known[v] = int(self.content.counts[calls.RESTORED])
        return self._call(f"{way}{_value_type(variable)}", reference, 1, kept, len(kept))

    def _owner(self, references: Any, k: int, types: tuple[str, ...]) -> tuple[int, int] | None:
        """Return the variable and the place of a reference; None if it is not one of these types."""
        if not references[k] < len(self._elements):
            return None
        v, place = self._elements[references[k]]
        return (v, place) if TYPES[self._table.variables[v].type] in types else None

    def _set(self, references: int, values: list[Any], types: tuple[str, ...]) -> int:
        """Set elements; an array is passed to the FMU with the last one of its elements in a row."""
        rows, worst = (ctypes.c_uint32 * len(values)).from_address(references), OK
        for k, value in enumerate(values):
            owner = self._owner(rows, k, types)
            if owner is None:
                return self._refuse(f"Set{types[0]}", f"value reference {rows[k]} is not of type {types[0]}")
            following = self._owner(rows, k + 1, types) if k + 1 < len(values) else None
            last = following is None or following[0] != owner[0]
            status = self._set_element(*owner, value, is_last=last)
            if status > _WARNING:
                return status
            worst = max(worst, status)
        return worst

    def _set_element(self, v: int, place: int, value: Any, *, is_last: bool) -> int:
        variable = self._table.variables[v]
        if variable.causality == "structuralParameter":
            return self._check_structural(variable, place, value)
        if variable.size > 1 and self._known[v] != self.content.counts[calls.RESTORED]:
            status = self._exchange("Get", v)
            if status > _WARNING:
                return status
        kept = self._kept(v)
        kept[place] = value
        if kept[place] != value:
            text = f"{variable.names[0]} = {value} does not fit into its type, {variable.type}"
            return self._refuse(f"Set{_value_type(variable)}", text)
        return self._exchange("Set", v) if is_last else OK

    def _check_structural(self, variable: Fmi3Variable, place: int, value: Any) -> int:
        start = _start(variable, place)
        if value == start:
            return OK
        return self._refuse(
            f"Set{_value_type(variable)}",
            f"{variable.names[0]} = {value}: it is a structural parameter, and the sizes of arrays cannot be changed "
            f"here; leave it at its start value {start}, or export the FMU with this value",
        )

    def _get(self, references: int, count: int, types: tuple[str, ...], put: Callable[[int, Any, str], int]) -> int:
        """Get elements, each variable with one call for its elements in a row; `put` stores a value."""
        rows, worst, before = (ctypes.c_uint32 * count).from_address(references), OK, -1
        for k in range(count):
            owner = self._owner(rows, k, types)
            if owner is None:
                return self._refuse(f"Get{types[0]}", f"value reference {rows[k]} is not of type {types[0]}")
            v, place = owner
            status = OK if v == before else self._exchange("Get", v)
            if status <= _WARNING:
                status = max(status, put(k, self._kept(v)[place], self._table.variables[v].names[0]))
            if status > _WARNING:
                return status
            worst, before = max(worst, status), v
        return worst


def _value_type(variable: Fmi3Variable) -> str:
    return "Int64" if variable.type == "Enumeration" else variable.type


def _start(variable: Fmi3Variable, place: int) -> Any:
    """Return the start value of an element that is not real, 0 without one."""
    text = variable.start_of(place)
    if variable.type == "String":
        return (text or "").encode()
    return text in ("true", "1") if variable.type == "Boolean" else int(text or 0)


def _adapter(functions: Fmi3Functions, table: Fmi3Table, slack: float) -> calls.Adapter:
    """Return the data for the calls of the loop, without an instance."""
    variables, elements = table.variables, tuple(table.elements)
    kinds = [{"Float64": calls.DOUBLE, "Float32": calls.SINGLE}.get(v.type, calls.OTHER) for v in variables]
    sizes = np.array([v.size for v in variables], dtype=np.int64)
    begins, totals = np.zeros(len(variables), dtype=np.int64), [0, 0, 0]
    for v, (kind, size) in enumerate(zip(kinds, sizes, strict=True)):
        begins[v] = totals[kind]
        totals[kind] += size
    count = len(elements)
    return calls.Adapter(
        **{name: functions.address(function) for name, function in _LOOP.items()},
        slack=float(slack),
        instance=np.zeros(1, np.int64),
        owner=np.array([v for v, _ in elements], dtype=np.int64),
        place=np.array([place for _, place in elements], dtype=np.int64),
        reference=np.array([v.reference for v in variables], dtype=np.uint32),
        kind=np.array(kinds, dtype=np.int64),
        size=sizes,
        begin=begins,
        known=np.zeros(len(variables), np.int64),
        doubles=np.zeros(totals[calls.DOUBLE]),
        singles=np.zeros(totals[calls.SINGLE], np.float32),
        last=np.zeros(count),
        last_known=np.zeros(count, np.int64),
        batch_reference=np.zeros(count, np.uint32),
        batch_place=np.zeros(count, np.int64),
        batch_value=np.zeros(count),
        ramp_element=np.zeros(count, np.uint32),
        ramp_start=np.zeros(count),
        ramp_slope=np.zeros(count),
        ramp_value=np.zeros(count),
        is_ramped=np.zeros(count, np.int64),
        clock=np.zeros(3),
        counts=np.zeros(4, np.int64),
        flags=np.zeros(3, np.uint8),
    )


#: Functions of FMI 3.0 that the calls of the loop make, by field of `Adapter`.
_LOOP = {
    "set_double": "SetFloat64",
    "get_double": "GetFloat64",
    "set_single": "SetFloat32",
    "get_single": "GetFloat32",
    "do_step": "DoStep",
    "save": "GetFMUState",
    "restore": "SetFMUState",
    "derive": "GetDirectionalDerivative",
}
