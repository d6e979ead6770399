"""Recording of a run: names, times and arrays of the recorded signals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import DISCRETE
from cosim.components.conversion import Conversion, to_si
from cosim.engine.march import Tape
from cosim.session.planning import Layout
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.errors import InputError, StepError, WiringError
from eightpost.signals import TimeSeries

Flags = NDArray[np.int64]

_NUMBERS = ("Real", *DISCRETE)


def recorded_names(system: System, scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the recorded variables: those of the scenario, else every output that is a number.

    Raises:
        WiringError: A name is unknown or its values are not numbers.
    """
    names = tuple(dict.fromkeys(scenario.record)) or _every_output(system)
    for name in names:
        if system.output(name).type not in _NUMBERS:
            raise WiringError(f"{name} is a {system.output(name).type} and cannot be recorded; record numbers")
    return names


def real_names(system: System, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that the loop records; discrete variables are recorded outside the loop."""
    return tuple(name for name in names if system.output(name).type == "Real")


def recorded_steps(scenario: Scenario, step: float, count: int) -> Flags:
    """Return 1 for each of the communication points 0 to `count` that is recorded: the first, the last, and every n-th.

    Raises:
        InputError: The record step is not a whole number of coupling steps.
    """
    flags = np.zeros(count + 1, np.int64)
    flags[:: _stride(scenario, step)] = 1
    flags[-1] = 1
    return flags


def blank_tape(layout: Layout, names: tuple[str, ...], rows: int) -> Tape:
    """Return a tape with space for `rows` communication points."""
    places = {name: k for k, name in enumerate((*layout.signals, *layout.extras))}
    columns = np.array([places[name] for name in names], dtype=np.uint32)
    return Tape(np.zeros((rows, len(names))), np.zeros(rows), columns, np.zeros(1, np.int64))


def recorded_series(
    system: System, names: tuple[str, ...], tape: Tape, discrete: Sequence[Sequence[float]] = ()
) -> TimeSeries:
    """Return the contents of a tape and the rows of discrete variables, in SI.

    Raises:
        StepError: A recorded value is not a number.
    """
    count = int(tape.position[0])
    values, units = _values(system, names, tape.rows[:count], discrete), []
    for row, name in zip(values, names, strict=True):
        conversion, unit = to_si(system.output(name))
        units.append(unit)
        if conversion != Conversion():
            row[:] = conversion.factor * row + conversion.offset
        if not np.isfinite(row).all():
            raise StepError(_not_a_number(name, tape.times[int(np.argmin(np.isfinite(row)))]))
    values.setflags(write=False)  # no other references exist, so no copy is needed
    return TimeSeries(tape.times[:count], values, names, tuple(units))


def _values(
    system: System, names: tuple[str, ...], real: NDArray[np.float64], discrete: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    """Return one row per name (M, R) from the rows per time of both kinds."""
    is_real = np.array([system.output(name).type == "Real" for name in names], dtype=bool)
    if is_real.all():
        return np.ascontiguousarray(real.T)
    values = np.empty((len(names), real.shape[0]))
    values[is_real] = real.T
    values[~is_real] = np.array(discrete, dtype=np.float64).reshape(real.shape[0], -1).T
    return values


def _not_a_number(name: str, time: float) -> str:
    return (
        f"{name} is not a number from {time:g} s on: check the inputs and the log of its component, or remove it from "
        "the record list ([scenario] record)"
    )


def _every_output(system: System) -> tuple[str, ...]:
    return tuple(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.causality == "output" and v.type in _NUMBERS
    )


def _stride(scenario: Scenario, step: float) -> int:
    if scenario.record_step is None:
        return 1
    stride = round(scenario.record_step / step)
    if stride < 1 or abs(stride * step - scenario.record_step) > 1e-9 * scenario.record_step:
        raise InputError(
            f"record_step {scenario.record_step} s is not a whole number of coupling steps of {step} s; change one"
        )
    return stride
