"""Variables of a shock's adjusters and temperature, and of what is known about their setting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from builder.fmu.interface import Interface, Variable
from eightpost.errors import FmuError
from eightpost.shock import Axis, Settings

#: Local variable that reports the distance from the measured settings.
BEYOND_SETTINGS = "beyond_settings"

#: First value references: of what is reported, of the temperature, of the adjusters. They are free in shock.toml.
_REPORTED, _TEMPERATURE, _CLICKS = 290, 295, 300


def with_settings(interface: Interface, settings: Settings, *, temperature_input: bool = False) -> Interface:
    """Return a shock's interface with its adjusters and temperature; force and states depend on all of them.

    Args:
        interface: Interface of the shock without settings.
        settings: Settings of the shock.
        temperature_input: Whether the temperature is an input instead of a parameter.

    Raises:
        FmuError: The temperature is to be an input, but it was not varied.
    """
    if temperature_input and not any(axis.is_temperature for axis in settings.axes):
        raise FmuError(
            "the shock has no temperature that could be an input: its files were not fitted over the temperature"
        )
    added = tuple(_variables(settings, temperature_input=temperature_input))
    known = tuple(v.name for v in added if v.causality != "local")
    inputs = tuple(v.name for v in added if v.causality == "input")
    return replace(
        interface,
        variables=(*interface.variables, *added),
        direct={name: (*names, *inputs) for name, names in interface.direct.items()},
        initial={
            name: names if name in interface.derivatives else (*names, *known)  # which are zero in equilibrium
            for name, names in interface.initial.items()
        },
    )


def _variables(settings: Settings, *, temperature_input: bool) -> Iterator[Variable]:
    yield _reported(
        BEYOND_SETTINGS,
        _REPORTED,
        "Distance of the setting beyond the measured ones, in intervals between them; 0 within",
    )
    yield _reported(
        "untested_settings",
        _REPORTED + 1,
        "1 while this combination of settings was not measured, so that interactions are unknown, else 0",
    )
    number = 0
    for axis in settings.axes:
        if axis.is_temperature:
            yield _temperature(axis, is_input=temperature_input)
        else:
            yield _clicks(axis, _CLICKS + number)
            number += 1


def _reported(name: str, reference: int, description: str) -> Variable:
    return Variable(name, reference, "Real", "local", "continuous", "1", None, None, None, None, description)


def _temperature(axis: Axis, *, is_input: bool) -> Variable:
    low, high = axis.nodes[0], axis.nodes[-1]
    return Variable(
        axis.variable,
        _TEMPERATURE,
        "Real",
        "input" if is_input else "parameter",
        "continuous" if is_input else "tunable",
        "K",
        "degC",
        axis.reference,
        1.0,
        None,
        f"Temperature of the shock, measured from {low:.5g} to {high:.5g} K",
    )


def _clicks(axis: Axis, reference: int) -> Variable:
    what = f"clicks {axis.counted}".strip() if axis.is_whole else axis.unit
    return Variable(
        axis.variable,
        reference,
        "Real",
        "parameter",
        "tunable",
        "1",
        None,
        axis.reference,
        axis.lowest,
        axis.highest,
        f"Setting of the adjuster {axis.name} in {what}, measured from {axis.nodes[0]:g} to {axis.nodes[-1]:g}",
    )
