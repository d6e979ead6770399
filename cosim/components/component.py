"""Protocol of a component for the master, its functions for the loop, and conversion of units."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import count
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cosim.engine import blocks
from eightpost import units
from eightpost.errors import EightpostError, StepError, UnknownUnitError, WiringError
from eightpost.fmi import ERROR, OK

# ---- Component ------------------------------------------------------------------------------------------------------

#: Types of variables that are numbers but not Real; enumerations are integers to FMI.
DISCRETE = ("Integer", "Boolean", "Enumeration")


#: SI base units and the radian, by whose exponents units are compared.
EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True, slots=True)
class UnitDefinition:
    """Unit as defined by the component: `SI value = factor * value + offset` in the given base units."""

    name: str  #: Name in the component's description.
    #: Exponents of kg, m, s, A, K, mol, cd, rad; zeros omitted.
    exponents: Mapping[str, int] = field(default_factory=dict)
    factor: float = 1.0  #: Factor to the SI base units.
    offset: float = 0.0  #: Offset to the SI base units.


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of a component."""

    name: str  #: Name of the variable.
    causality: str  #: input, output, parameter, local ...
    variability: str = "continuous"  #: continuous, tunable, fixed ...
    type: str = "Real"  #: Real, Integer, Boolean, Enumeration or String; Binary, which nothing sets or reads.
    unit: UnitDefinition | None = None  #: Unit; None if the component states none.
    start: float | bool | str | None = None  #: Default value.
    minimum: float | None = None  #: Declared minimum value.
    maximum: float | None = None  #: Declared maximum value.
    direct: frozenset[str] = frozenset()  #: Inputs that an output follows without delay; empty for other variables.
    items: Mapping[str, int] = field(default_factory=dict)  #: Numbers of an enumeration's items, by name.


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Abilities of a component beyond stepping with held inputs."""

    interpolates_inputs: bool = False
    variable_step: bool = True
    #: Size of the steps of a component that accepts one size only [s]; None if it does not state it.
    only_step: float | None = None
    state: bool = False
    derivatives: bool = False  #: Whether it states how outputs follow inputs without delay.


class Component(Protocol):
    """Component that is stepped. Values are in the component's own units, in the order of the requested names."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""

    @property
    def capabilities(self) -> Capabilities:
        """Abilities of the component."""

    @property
    def identity(self) -> str:
        """Identification that distinguishes components of the same name: the FMU's GUID."""

    @property
    def source(self) -> str:
        """Origin of the component: the FMU's file name."""

    @property
    def messages(self) -> tuple[str, ...]:
        """Warnings since the run began, each once."""

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Begin a run and enter initialization, with parameters set. Times in s."""

    def end_initialization(self) -> None:
        """Leave initialization; steps may follow."""

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set inputs. Integer, Boolean (1 is true) and enumeration values are numbers too."""

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set the time derivatives of real inputs for the next step; only if `interpolates_inputs`."""

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables. Integer, Boolean (1 is true) and enumeration values are numbers too."""

    def step(self, time: float, step: float) -> None:
        """Advance from `time` by `step` [s]."""

    def finish(self) -> None:
        """End the run and free its resources. It may be called at any time, and twice."""


# ---- Conversion between the units that two components define themselves ---------------------------------------------


@dataclass(frozen=True, slots=True)
class Conversion:
    """Linear unit conversion: `target = factor * source + offset`."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the value in the target's unit."""
        return self.factor * value + self.offset


def named_unit(name: str) -> UnitDefinition:
    """Return the definition of a unit that this project knows by name."""
    factor, offset = units.conversion(name, units.si_unit(name))
    return UnitDefinition(name, units.si_exponents(name), factor, offset)


def convert_between(source: UnitDefinition | None, target: UnitDefinition | None, what: str) -> Conversion:
    """Return the conversion from one unit to another; the identity if a side states no unit.

    Args:
        source: Unit of the source's values; None if it states none.
        target: Unit of the target's values; None if it states none.
        what: Connection, for the message.

    Raises:
        WiringError: The dimensions differ.
    """
    if source is None or target is None:
        return Conversion()
    source, target = _defined(source), _defined(target)
    if source.exponents != target.exponents:
        raise WiringError(f"{what}: cannot connect [{source.name}] to [{target.name}]: the dimensions differ")
    if (source.factor, source.offset) == (target.factor, target.offset):
        return Conversion()
    return Conversion(source.factor / target.factor, (source.offset - target.offset) / target.factor)


def to_si(variable: Variable) -> tuple[Conversion, str]:
    """Return the conversion of a variable to SI and the SI unit's name; the identity if it states no unit."""
    if variable.unit is None:
        return Conversion(), "1"
    definition = _defined(variable.unit)
    name = _si_name(frozenset(definition.exponents.items()))
    return (Conversion(definition.factor, definition.offset), name) if name else (Conversion(), "1")


@lru_cache(maxsize=256)
def _si_name(exponents: frozenset[tuple[str, int]]) -> str | None:
    """Return the SI unit with these exponents of base units; None if this project knows none."""
    return next((name for name in units.SI_UNITS if frozenset(units.si_exponents(name).items()) == exponents), None)


def _defined(definition: UnitDefinition) -> UnitDefinition:
    if "?" not in definition.exponents:
        return definition
    try:
        return named_unit(definition.name)
    except UnknownUnitError as error:
        raise WiringError(f"unit {definition.name!r} is neither defined by its component nor known: {error}") from error


# ---- Functions of a component for the loop: an FMU's own, or callbacks into a Python component -----------------------

#: FMI names of the functions in a table that the loop calls directly, in the order of its fields.
FUNCTIONS = (
    "SetReal", "SetRealInputDerivatives", "DoStep", "GetReal", "GetFMUstate", "SetFMUstate", "GetDirectionalDerivative",
)  # fmt: skip


@dataclass(frozen=True)
class FunctionTable:
    """Addresses of FMI functions, the instance to call them with, and value references by name.

    An address of 0 is a missing function. `keep` holds objects that must live as long as the addresses are used.
    """

    set_real: int
    set_slopes: int
    do_step: int
    get_real: int
    save: int
    restore: int
    derive: int
    free: int
    instance: int
    references: Mapping[str, int]
    keep: Any = None


@runtime_checkable
class Native(Protocol):
    """Component whose functions can be called by address."""

    def functions(self) -> FunctionTable:
        """Return the addresses; call after `begin`."""

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call that the component refused."""


def address_of(function: Any) -> int:
    """Return the address of a C function or callback, which must live as long as the address is used."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def function_table(component: Component) -> FunctionTable:
    """Return a component's functions; those of a Python component are callbacks, which take the GIL."""
    return component.functions() if isinstance(component, Native) else Callbacks(component).table()


def free_states(
    tables: Sequence[FunctionTable], states: NDArray[np.int64], calls: NDArray[np.int64] | None = None
) -> None:
    """Free the states that the loop saved; the array holds groups of one state per component.

    Args:
        tables: Functions by component.
        states: Saved states.
        calls: Number of calls so far, and the component that is called, both updated.
    """
    for k in np.flatnonzero(states):
        place = int(k) % len(tables)
        if calls is not None:
            calls[:] = calls[0] + 1, place
        if tables[place].free:
            blocks.call_state(tables[place].free, tables[place].instance, states.ctypes.data + 8 * int(k))


class Callbacks:
    """Calls from the loop to a Python component; an exception is kept in `error`, and the status is an error.

    The loop identifies a saved state by a number, as an FMU's by an address.

    Args:
        component: Component to call; it must have begun before the loop calls.
    """

    def __init__(self, component: Any) -> None:
        self._component = component
        self._names = [v.name for v in component.variables.values()]
        self._named_before: dict[bytes, tuple[str, ...]] = {}
        self._numbers = count(1)
        self._states: dict[int, object] = {}
        self.error: BaseException | None = None

    def table(self) -> FunctionTable:
        """Return the addresses of callbacks; `save`, `restore`, `free` and `derive` only if the component has them."""
        functions = {
            "set_real": blocks.EXCHANGE(self._guarded(self._set)),
            "set_slopes": blocks.SLOPES(self._guarded(self._set_slopes)),
            "do_step": blocks.STEP(self._guarded(self._step)),
            "get_real": blocks.EXCHANGE(self._guarded(self._get)),
        }
        if hasattr(self._component, "save"):
            functions |= {
                "save": blocks.STATE(self._guarded(self._save)),
                "restore": blocks.STATE(self._guarded(self._restore)),
                "free": blocks.STATE(self._free_quietly),
            }
        if hasattr(self._component, "derive"):
            functions["derive"] = blocks.DERIVE(self._guarded(self._derive))
        addresses = dict.fromkeys(("save", "restore", "derive", "free"), 0)
        addresses |= {name: address_of(function) for name, function in functions.items()}
        references = {name: k for k, name in enumerate(self._names)}
        return FunctionTable(**addresses, instance=0, references=references, keep=(self, functions))

    def _guarded(self, function: Callable[..., None]) -> Callable[..., int]:
        def call(_instance: Any, *arguments: Any) -> int:
            try:
                function(*arguments)
            except BaseException as error:  # raised again by the caller of the loop
                self.error = error
                return ERROR
            return OK

        return call

    def _named(self, address: int, count: int) -> tuple[str, ...]:
        key = ctypes.string_at(address, 4 * count)
        if key not in self._named_before:
            self._named_before[key] = tuple(self._names[k] for k in np.frombuffer(key, np.uint32))
        return self._named_before[key]

    def _set(self, references: int, count: int, values: int) -> None:
        self._component.set(self._named(references, count), _array(values, count).tolist())

    def _set_slopes(self, references: int, count: int, _orders: int, values: int) -> None:
        self._component.set_derivatives(self._named(references, count), _array(values, count).tolist())

    def _get(self, references: int, count: int, values: int) -> None:
        read: Sequence[float] = self._component.get(self._named(references, count))
        _array(values, count)[:] = read

    def _step(self, time: float, step: float, _final: int) -> None:
        self._component.step(time, step)

    def _derive(self, unknowns: int, sought: int, knowns: int, given: int, changes: int, result: int) -> None:
        outputs, inputs = self._named(unknowns, sought), self._named(knowns, given)
        _array(result, sought)[:] = self._component.derive(outputs, inputs, _array(changes, given).tolist())

    def _save(self, slot: int) -> None:
        number = ctypes.c_int64.from_address(slot)
        if number.value in self._states:
            self._component.free(self._states.pop(number.value))
        number.value = next(self._numbers)
        self._states[number.value] = self._component.save()

    def _restore(self, number: int) -> None:
        self._component.restore(self._states[number])

    def _free_quietly(self, _instance: Any, slot: int) -> int:
        """Free a state at the end of a run; errors are ignored, because a failure has been reported already."""
        state = self._states.pop(ctypes.c_int64.from_address(slot).value, None)
        if state is not None:
            with suppress(EightpostError):
                self._component.free(state)
        return OK


def _array(address: int, count: int) -> NDArray[np.float64]:
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))
