"""Typed calls of the C functions of an FMU of FMI 2.0 or 3.0 for co-simulation, through fmpy."""

from __future__ import annotations

import ctypes
import logging
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException

from cosim.components.component import FUNCTIONS, address_of
from cosim.components.fmu_description import Row, Rows
from cosim.components.watch import FmuLog
from cosim.engine import blocks
from cosim.engine import fmi3_calls as calls
from cosim.engine.blocks import INTEGERS, REALS, Block
from eightpost.extras import is_installed
from eightpost.fmi import ERROR, function_name

# ==== Calls of an FMI 2.0 FMU for co-simulation through fmpy, and libraries that lack functions ======================

_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3  # fmi2StatusKind


class _MissingFunction:
    """Stand-in for a function that the library lacks: it returns an error."""

    def __call__(self, *_arguments: Any) -> int:
        """Return fmi2Error or fmi3Error."""
        return ERROR


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
        return plain or getattr(self._dll, f"{self._identifier}_{name}", None) or _MissingFunction()

    def has(self, name: str) -> bool:
        """Return whether it has a function, e.g. fmi2DoStep."""
        return not isinstance(getattr(self, name), _MissingFunction)


class FMU2Elements(fmi2.FMU2Slave):  # type: ignore[misc]  # fmpy has no types; it finds the FMI version in the class name
    """Instance of an FMI 2.0 FMU."""

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
        in_c = {name: f"fmi2{name}" for name in FUNCTIONS}
        addresses = {name: address_of(getattr(self.dll, c)) if self.dll.has(c) else 0 for name, c in in_c.items()}
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


# ==== Calls of an FMI 3.0 FMU for co-simulation through fmpy, with its elements in place of whole arrays =============

_LOG = logging.getLogger(__name__)
_KINDS = {
    "pointer": ctypes.c_void_p, "size": ctypes.c_size_t, "real": ctypes.c_double, "int": ctypes.c_int,
    "byte": ctypes.c_bool,
}  # fmt: skip
#: Functions of FMI 3.0 that the calls of the loop make, by field of `Adapter`.
_LOOP = {
    "set_double": "SetFloat64", "get_double": "GetFloat64", "set_single": "SetFloat32", "get_single": "GetFloat32",
    "do_step": "DoStep", "save": "GetFMUState", "restore": "SetFMUState",
    "derive": "GetDirectionalDerivative",
}  # fmt: skip
#: Functions of the loop that a library may lack.
_OPTIONAL = ("GetFMUstate", "SetFMUstate", "GetDirectionalDerivative")
_REFUSING = blocks.EXCHANGE_SIZED(lambda *_: ERROR)
_INTEGERS = (-(1 << 31), (1 << 31) - 1)


class FMU3Elements(fmi3.FMU3Slave):  # type: ignore[misc]  # fmpy has no types; it finds the FMI version in the class name
    """Instance of an FMI 3.0 FMU. Events are left to the FMU, and no step may end early.

    Args:
        table: Variables of the FMU.
        slack: Internal step that the FMU declares (fixedInternalStepSize) [s]; 0 if it declares none.
        compile_calls: Whether the calls that the loop makes are machine code, so that they need no Python; otherwise
            they are interpreted, with equal results.
        options: Arguments of fmpy's class.
    """

    def __init__(self, table: Rows, *, slack: float = 0.0, compile_calls: bool = True, **options: Any) -> None:
        super().__init__(**options)
        self._table, self._experiment = table, dict[str, Any]()
        has = {field: f"fmi3{name}" for field, name in _LOOP.items() if self.dll.has(f"fmi3{name}")}
        addresses = {field: address_of(getattr(self.dll, name)) for field, name in has.items()}
        self._content = _adapter(table, slack, addresses)
        self._block = Block(self._content)
        self._values: dict[int, Any] = {}
        self._known: dict[int, int] = {}
        machine_code = _machine_code() if compile_calls else {}
        self._functions_of_2 = {}
        for number, (name, kinds) in enumerate(calls.ENTRIES.items()):
            prototype = ctypes.CFUNCTYPE(ctypes.c_int, *(_KINDS[kind] for kind in kinds))
            function = prototype(machine_code.get(name) or partial(self._interpret, number, kinds))
            self._functions_of_2[name.removeprefix("fmi2")] = function
        self._put_start_values()

    def _loadFunctions(self) -> None:  # noqa: N802
        self.dll: Library = Library(self.dll, self.modelIdentifier)
        super()._loadFunctions()

    def _interpret(self, number: int, kinds: Sequence[str], _instance: int, *arguments: Any) -> int:
        pairs = list(zip(kinds[1:], arguments, strict=True))
        integers = [int(value or 0) for kind, value in pairs if kind != "real"]
        reals = [value for kind, value in pairs if kind == "real"]
        integers += [0] * (INTEGERS - len(integers))
        reals += [0.0] * (REALS - len(reals))
        return int(calls.call(self._content, number, *integers, *reals))

    # ---- Life -------------------------------------------------------------------------------------------------------

    def begin(self, log: FmuLog) -> None:
        """Instantiate, with all messages switched on.

        Raises:
            RuntimeError: The FMU returned no instance.
        """
        self._log, address = log, self._block.address
        self._entry = fmi3.fmi3LogMessageCallback(lambda _, status, __, text: log.take(status, text or b""))
        self._update = ctypes.cast(self._functions_of_2["intermediateUpdate"], fmi3.fmi3IntermediateUpdateCallback)
        ramped = [row.reference for row in self._table.ramped]
        self._required = (ctypes.c_uint32 * len(ramped))(*ramped)
        resources = f"{Path(self.unzipDirectory) / 'resources'}{os.sep}"
        self.component = self.fmi3InstantiateCoSimulation(
            self.instanceName.encode(), self.guid.encode(), resources.encode(), False, True, False, False,
            self._required, len(ramped), address, self._entry, self._update,
        )  # fmt: skip
        if not self.component:
            raise RuntimeError("Failed to instantiate model")
        self._content.instance[0] = self.component

    def setupExperiment(self, **times: Any) -> None:  # noqa: N802 -- as fmpy's class for FMI 2.0
        """Store the times for `enterInitializationMode`."""
        self._experiment = times

    def enterInitializationMode(self) -> None:  # noqa: N802
        """Enter initialization mode with the stored times."""
        super().enterInitializationMode(**self._experiment)

    def reset(self) -> None:
        """Reset the instance, and the kept values of arrays with it."""
        self._put_start_values()
        super().reset()

    def missing(self, functions: Sequence[str]) -> list[str]:
        """Return the names in C of those functions that the library lacks, for names of FMI 2.0 like DoStep."""
        needed: dict[str, None] = {}
        for name in functions:
            if name in ("SetReal", "GetReal"):
                kinds = {row.type for row in self._table.rows if row.is_real}
                needed |= dict.fromkeys(f"fmi3{name[:3]}{kind}" for kind in sorted(kinds))
            elif name != "SetRealInputDerivatives":
                needed[f"fmi3{function_name(name)}"] = None
        return [name for name in needed if not self.dll.has(name)]

    # ---- Calls of the loop ------------------------------------------------------------------------------------------

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function that the loop also calls, by its name in FMI 2.0, e.g. SetReal.

        Raises:
            FMICallException: It returned a status above a warning.
        """
        status = self._functions_of_2[name](self._block.address, *arguments)
        if status > 1:
            # The host sets inputs in intermediate updates, so this is the function that failed.
            in_c = "SetFloat64" if name == "SetRealInputDerivatives" else function_name(name)
            raise FMICallException(f"fmi3{in_c}", status)

    def addresses(self) -> tuple[int, dict[str, int]]:
        """Return the instance and the addresses of the functions for the loop; 0 for a missing one."""
        lacking = [n for n in _OPTIONAL if not self.dll.has(f"fmi3{function_name(n)}")]
        addresses = {n: 0 if n in lacking else address_of(self._functions_of_2[n]) for n in FUNCTIONS}
        return self._block.address, addresses

    def free_state(self, state: Any) -> int:
        """Free the state that a pointer refers to; return the status."""
        return int(self.dll.fmi3FreeFMUState(self.component, state))

    def last_step(self) -> tuple[float, bool]:
        """Return the time that the last step reached [s], and whether the FMU ended the run in it."""
        return float(self._content.clock[calls.REACHED]), bool(self._content.counts[calls.ENDED])

    # ---- Values that the loop does not set or get -------------------------------------------------------------------

    def set_values(self, kind: str, references: Any, values: Any) -> None:
        """Set elements of a type; an array is passed to the FMU with the last one of its elements in a row."""
        if kind == "Real":
            self.call("SetReal", references, len(values), values)
            return
        owners = [self._table.elements[reference] for reference in references]
        for k, ((v, place), value) in enumerate(zip(owners, values, strict=True)):
            row, values_of_row = self._table.rows[v], self._kept(v)
            if row.written.causality == "structuralParameter":
                self._check_structural(row, place, value)
                continue
            if row.size > 1 and self._known[v] != self._content.counts[calls.RESTORED]:
                self._exchange("Get", v)
            values_of_row[place] = value
            if values_of_row[place] != value:
                self._refuse(
                    f"Set{_value_type(row)}", f"{row.names[0]} = {value} does not fit into its type, {row.type}"
                )
            if k + 1 == len(owners) or owners[k + 1][0] != v:
                self._exchange("Set", v)

    def get_values(self, kind: str, references: Any, values: Any) -> None:
        """Get elements of a type, each variable with one call for its elements in a row."""
        if kind == "Real":
            self.call("GetReal", references, len(values), values)
            return
        before = -1
        for k, (v, place) in enumerate(self._table.elements[reference] for reference in references):
            if v != before:
                self._exchange("Get", v)
            before, value = v, self._kept(v)[place]
            if not _INTEGERS[0] <= value <= _INTEGERS[1]:
                name = self._table.rows[v].names[0]
                text = f"{name} = {value} does not fit into 32 bits, which this program uses for integers"
                self._refuse("GetInt64", text)
            values[k] = value

    def _refuse(self, function: str, text: str) -> None:
        self._log.take(ERROR, text.encode())
        raise FMICallException(f"fmi3{function}", ERROR)

    def _check_structural(self, row: Row, place: int, value: Any) -> None:
        if value != (start := _start(row, place)):
            self._refuse(
                f"Set{_value_type(row)}",
                f"{row.names[0]} = {value}: it is a structural parameter, and the sizes of arrays cannot be changed "
                f"here; leave it at its start value {start}, or export the FMU with this value",
            )

    def _put_start_values(self) -> None:
        """Make the kept values the start values, which an instance has at first and after a reset."""
        content, restored = self._content, int(self._content.counts[calls.RESTORED])
        calls.clear_ramps(content)
        content.known[:] = content.last_known[:] = restored
        self._known = dict.fromkeys(range(len(self._table.rows)), restored)
        self._values.clear()
        for e, (v, place) in enumerate(self._table.elements):
            row = self._table.rows[v]
            if row.is_real:
                numbers = content.doubles if row.type == "Float64" else content.singles
                content.last[e] = numbers[content.begin[v] + place] = float(row.start_of(place) or 0.0)

    def _kept(self, v: int) -> Any:
        """Return the kept values of a variable that is not real, at first its start values."""
        if v not in self._values:
            row = self._table.rows[v]
            kept = (getattr(fmi3, f"fmi3{_value_type(row)}") * row.size)()
            for place in range(row.size):
                kept[place] = _start(row, place)
            self._values[v] = kept
        return self._values[v]

    def _exchange(self, way: str, v: int) -> None:
        row, values = self._table.rows[v], self._kept(v)
        if way == "Get":
            self._known[v] = int(self._content.counts[calls.RESTORED])
        function = getattr(self, f"fmi3{way}{_value_type(row)}")
        function(self.component, (ctypes.c_uint32 * 1)(row.reference), 1, values, len(values))


def _value_type(row: Row) -> str:
    return "Int64" if row.type == "Enumeration" else row.type


def _start(row: Row, place: int) -> Any:
    """Return the start value of an element that is not real, 0 without one."""
    text = row.start_of(place)
    if row.type == "String":
        return (text or "").encode()
    return text in ("true", "1") if row.type == "Boolean" else int(text or 0)


def _adapter(table: Rows, slack: float, addresses: Mapping[str, int]) -> calls.Adapter:
    """Return the data for the calls of the loop; a function without an address returns an error."""
    rows, elements = table.rows, table.elements
    kinds = [{"Float64": calls.DOUBLE, "Float32": calls.SINGLE}.get(row.type, calls.OTHER) for row in rows]
    sizes = np.array([row.size for row in rows], dtype=np.int64)
    begins, totals = np.zeros(len(rows), dtype=np.int64), [0, 0, 0]
    for v, (kind, size) in enumerate(zip(kinds, sizes, strict=True)):
        begins[v] = totals[kind]
        totals[kind] += size
    count = len(elements)
    return calls.Adapter(
        **{name: addresses.get(name) or address_of(_REFUSING) for name in _LOOP},
        slack=float(slack),
        instance=np.zeros(1, np.int64),
        owner=np.array([v for v, _ in elements], dtype=np.int64),
        place=np.array([place for _, place in elements], dtype=np.int64),
        reference=np.array([row.reference for row in rows], dtype=np.uint32),
        kind=np.array(kinds, dtype=np.int64),
        size=sizes,
        begin=begins,
        known=np.zeros(len(rows), np.int64),
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


@cache
def _machine_code() -> dict[str, int]:
    """Return the addresses of the compiled calls of the loop; empty if they cannot be compiled."""
    if not is_installed("numba"):
        return {}
    from cosim.engine.machine_code import c_functions  # noqa: PLC0415 -- LLVM, which FMI 2.0 does not need here

    empty = _adapter(Rows((), are_numbered=True), 0.0, {})
    try:
        return c_functions(calls.call, Block(empty).kind, calls.ENTRIES)
    except (RuntimeError, OSError) as error:
        _LOG.warning("calls of FMI 3.0 FMUs are interpreted, because they cannot be compiled: %s", error)
        return {}
