"""Texts for failed FMI calls: the component, the time, the cause, the inputs, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.component import Variable

#: fmi2Status above a warning.
DISCARD, ERROR, FATAL, PENDING = 2, 3, 4, 5

_NAMES = {DISCARD: "fmi2Discard", ERROR: "fmi2Error", FATAL: "fmi2Fatal", PENDING: "fmi2Pending"}
_ADVICE = {
    ERROR: "its inputs may be out of its range or the coupling step too large for it; it can be started again",
    FATAL: "it is not called again in this process; load it again for another run, and report the fault to its maker",
    PENDING: (
        "it steps in the background (canRunAsynchronuously), and this master waits for each step: ask its maker for "
        "an FMU that completes a step before doStep returns"
    ),
}
_INPUTS_SHOWN = 12


@dataclass(frozen=True, slots=True)
class Place:
    """State of a component when it failed.

    Args:
        name: Name of the component.
        source: Name of its file.
        time: Time at which its last call began [s].
        inputs: Last values of its inputs, in its own units.
    """

    name: str
    source: str
    time: float
    inputs: Mapping[str, float] = field(default_factory=dict)


def returned(status: int, function: str = "it") -> str:
    """Return a sentence that describes a status."""
    return f"{function} returned {_NAMES.get(status, f'{status}, which is no status of FMI')}."


def advice(status: int) -> str:
    """Return the advice for a status."""
    return _ADVICE.get(status, "tell its maker")


def failure_text(
    place: Place, variables: Mapping[str, Variable], *, failed: str, why: str, messages: str, to_do: str = ""
) -> str:
    """Return the report of a failed call.

    Args:
        place: Component, time and inputs.
        variables: Variables of the component, for the units of the inputs.
        failed: Failure, without the component's name: "failed to step from 0.5 s by 0.001 s".
        why: Cause, as a sentence.
        messages: Last messages of the component.
        to_do: Advice.
    """
    when = "" if " from " in failed else f" at {place.time:g} s"
    parts = [
        f"component {place.name!r} ({place.source}) {failed}{when}: {why}",
        f"Last messages: {messages.rstrip('.')}.",
    ]
    parts += [_inputs(place.inputs, variables)] if place.inputs else []
    parts += [f"What to do: {to_do}"] if to_do else []
    return " ".join(parts)


def no_state(name: str, source: str) -> str:
    """Return the message for a component that cannot save its state."""
    return (
        f"component {name!r} ({source}) cannot save its state (canGetAndSetFMUstate is false in its model "
        "description); use an algorithm that repeats no step"
    )


def unknown_state(name: str, source: str) -> str:
    """Return the message for an unknown state."""
    return (
        f"component {name!r} ({source}) does not know this state: it belongs to another component, to a run that has "
        "ended, or has been freed; save a state in this run"
    )


def not_begun(name: str, source: str) -> str:
    """Return the message for a component that has not begun."""
    return f"component {name!r} ({source}) is not running; call begin() first"


def _inputs(inputs: Mapping[str, float], variables: Mapping[str, Variable]) -> str:
    shown = [f"{name} = {value:g}{_unit(variables.get(name))}" for name, value in inputs.items()]
    more = f" and {len(shown) - _INPUTS_SHOWN} more" if len(shown) > _INPUTS_SHOWN else ""
    return f"Its inputs: {', '.join(shown[:_INPUTS_SHOWN])}{more}."


def _unit(variable: Variable | None) -> str:
    unit = variable.unit if variable is not None else None
    return "" if unit is None or unit.name in ("", "1") else f" {unit.name}"
