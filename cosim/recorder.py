"""What is recorded and when: every output unless said otherwise, at coupling points, in SI."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.conversion import Conversion, to_si
from cosim.engine.march import Tape
from cosim.planning import Layout
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import InputError, StepError, WiringError
from eightpost.signals import TimeSeries

Flags = NDArray[np.int64]


def recorded_names(system: System, scenario: Scenario) -> tuple[str, ...]:
    """Return what is recorded: what the scenario asks for, else every real output.

    Raises:
        WiringError: A name is unknown or not a real variable.
    """
    names = tuple(dict.fromkeys(scenario.record)) or _every_output(system)
    for name in names:
        if system.output(name).type != "Real":
            raise WiringError(f"{name} is a {system.output(name).type} and cannot be recorded; record real variables")
    return names


def recorded_steps(scenario: Scenario, step: float, count: int) -> Flags:
    """Return 1 for each of the coupling points 0 to `count` that is recorded: the first, the last, and every so many.

    Raises:
        InputError: The record step is not a whole number of coupling steps.
    """
    flags = np.zeros(count + 1, np.int64)
    flags[:: _stride(scenario, step)] = 1
    flags[-1] = 1
    return flags


def blank_tape(layout: Layout, names: tuple[str, ...], rows: int) -> Tape:
    """Return room for `rows` points."""
    places = {name: k for k, name in enumerate((*layout.signals, *layout.extras))}
    columns = np.array([places[name] for name in names], dtype=np.uint32)
    return Tape(np.zeros((rows, len(names))), np.zeros(rows), columns, np.zeros(1, np.int64))


def recorded_series(system: System, names: tuple[str, ...], tape: Tape) -> TimeSeries:
    """Return what a tape holds so far, in SI."""
    count = int(tape.position[0])
    values, units = np.ascontiguousarray(tape.rows[:count].T), []
    for row, name in zip(values, names, strict=True):
        conversion, unit = to_si(system.output(name))
        units.append(unit)
        if conversion != Conversion():
            row[:] = conversion.factor * row + conversion.offset
        if not np.isfinite(row).all():
            raise StepError(_not_a_number(name, tape.times[int(np.argmin(np.isfinite(row)))]))
    values.setflags(write=False)  # nobody else has them: they need no copy
    return TimeSeries(tape.times[:count], values, names, tuple(units))


def _not_a_number(name: str, time: float) -> str:
    return (
        f"{name} is not a number from {time:g} s on: look at what its component was given and logged, or leave it out "
        "of the record list ([scenario] record)"
    )


def _every_output(system: System) -> tuple[str, ...]:
    return tuple(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.causality == "output" and v.type == "Real"
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
