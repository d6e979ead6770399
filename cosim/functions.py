"""A component's functions by address, as the loop calls them: an FMU's own, or callbacks into a Python component."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cosim.component import Component
from cosim.engine import calls
from eightpost.errors import StepError

#: fmi2Status that a callback returns.
OK, ERROR = 0, 3


@dataclass(frozen=True)
class FunctionTable:
    """Addresses of FMI functions, the instance that they take, and value references by name.

    An address of 0 is a function that is not there. `keep` holds what must outlive the addresses.
    """

    set_real: int
    set_slopes: int
    do_step: int
    get_real: int
    save: int
    restore: int
    free: int
    instance: int
    references: Mapping[str, int]
    keep: Any = None


#: The FMI names of a table's functions, in its order.
FUNCTIONS = (
    "SetReal", "SetRealInputDerivatives", "DoStep", "GetReal", "GetFMUstate", "SetFMUstate", "FreeFMUstate",
)  # fmt: skip


@runtime_checkable
class Native(Protocol):
    """A component whose functions can be called by address."""

    def functions(self) -> FunctionTable:
        """Return the addresses; to be called after `begin`."""

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call that it refused."""


def address_of(function: Any) -> int:
    """Return the address of a C function or callback, which must outlive its use."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def function_table(component: Component) -> FunctionTable:
    """Return a component's functions; those of a Python component are callbacks, which take the GIL."""
    return component.functions() if isinstance(component, Native) else Callbacks(component).table()


def free_states(tables: Sequence[FunctionTable], states: NDArray[np.int64]) -> None:
    """Free the states that the loop saved, some for each part one after the other."""
    for k in np.flatnonzero(states):
        table = tables[int(k) % len(tables)]
        if table.free:
            calls.save_state(table.free, table.instance, states, int(k))


class Callbacks:
    """Calls from the loop to a Python component; what it raises is kept in `error`, and the status says so."""

    def __init__(self, component: Component) -> None:
        self._component = component
        self._names = [v.name for v in component.variables.values()]
        self.error: BaseException | None = None
        self._known: dict[bytes, tuple[str, ...]] = {}

    def table(self) -> FunctionTable:
        """Return the addresses of callbacks."""
        functions = self._functions()
        addresses = dict.fromkeys(("save", "restore", "free"), 0)
        addresses |= {name: address_of(function) for name, function in functions.items()}
        references = {name: k for k, name in enumerate(self._names)}
        return FunctionTable(**addresses, instance=0, references=references, keep=(self, functions))

    def _functions(self) -> dict[str, Any]:
        """Callbacks by their names in a table; those that are left out are not there."""
        return {
            "set_real": calls.EXCHANGE(self._guarded(self._set)),
            "set_slopes": calls.SLOPES(self._guarded(self._set_slopes)),
            "do_step": calls.STEP(self._guarded(self._step)),
            "get_real": calls.EXCHANGE(self._guarded(self._get)),
        }

    def _guarded(self, function: Callable[..., None]) -> Callable[..., int]:
        def call(_instance: Any, *arguments: Any) -> int:
            try:
                function(*arguments)
            except BaseException as error:  # it goes on in the loop's caller
                self.error = error
                return ERROR
            return OK

        return call

    def _named(self, address: int, count: int) -> tuple[str, ...]:
        key = ctypes.string_at(address, 4 * count)
        if key not in self._known:
            self._known[key] = tuple(self._names[k] for k in np.frombuffer(key, np.uint32))
        return self._known[key]

    def _set(self, references: int, count: int, values: int) -> None:
        self._component.set(self._named(references, count), _array(values, count).tolist())

    def _set_slopes(self, references: int, count: int, _orders: int, values: int) -> None:
        self._component.set_derivatives(self._named(references, count), _array(values, count).tolist())

    def _get(self, references: int, count: int, values: int) -> None:
        found: Sequence[float] = self._component.get(self._named(references, count))
        _array(values, count)[:] = found

    def _step(self, time: float, step: float, _final: int) -> None:
        self._component.step(time, step)


def _array(address: int, count: int) -> NDArray[np.float64]:
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))
