"""What a refused FMI call means, in words: which component, when, why, with what inputs, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.component import Variable

#: fmi2Status above a warning.
DISCARD, ERROR, FATAL, PENDING = 2, 3, 4, 5

_NAMES = {DISCARD: "fmi2Discard", ERROR: "fmi2Error", FATAL: "fmi2Fatal", PENDING: "fmi2Pending"}
_ADVICE = {
    ERROR: "its inputs may be out of its range or the coupling step too large for it; it may begin again",
    FATAL: "it is not called again in this process; load it anew for another run, and tell its maker",
    PENDING: (
        "it steps in the background (canRunAsynchronuously), and this master waits for each step: ask its maker for "
        "one that ends a step before doStep returns"
    ),
}
_INPUTS_SHOWN = 12


@dataclass(frozen=True, slots=True)
class Place:
    """Where a run stood when a component failed.

    Args:
        name: The component's.
        source: Its file's name.
        time: At which its last call began [s].
        inputs: The last values of its inputs, in its own units.
    """

    name: str
    source: str
    time: float
    inputs: Mapping[str, float] = field(default_factory=dict)


def returned(status: int, function: str = "it") -> str:
    """Return what a status is as a sentence."""
    return f"{function} returned {_NAMES.get(status, f'{status}, which is no status of FMI')}."


def advice(status: int) -> str:
    """Return what to do about a status."""
    return _ADVICE.get(status, "tell its maker")


def failure_text(
    place: Place, variables: Mapping[str, Variable], *, failed: str, why: str, said: str, to_do: str = ""
) -> str:
    """Return the report of a failed call.

    Args:
        place: Which, when and with what inputs.
        variables: The component's, for the units of the inputs.
        failed: What it did not do, after its name: "failed to step from 0.5 s by 0.001 s".
        why: A sentence.
        said: Its last messages.
        to_do: What to do.
    """
    when = "" if " from " in failed else f" at {place.time:g} s"
    parts = [f"component {place.name!r} ({place.source}) {failed}{when}: {why}", f"It said: {said.rstrip('.')}."]
    parts += [_inputs(place.inputs, variables)] if place.inputs else []
    parts += [f"What to do: {to_do}"] if to_do else []
    return " ".join(parts)


def no_state(name: str, source: str) -> str:
    """Return why a state cannot be saved."""
    return (
        f"component {name!r} ({source}) cannot save its state (canGetAndSetFMUstate is false in its model "
        "description); take an algorithm that repeats no step"
    )


def unknown_state(name: str, source: str) -> str:
    """Return why a state cannot be restored."""
    return (
        f"component {name!r} ({source}) does not know this state: it is another component's, of a run that has ended, "
        "or freed; save one in this run"
    )


def not_begun(name: str, source: str) -> str:
    """Return why a component cannot be stepped."""
    return f"component {name!r} ({source}) does not run; begin() comes first"


def _inputs(inputs: Mapping[str, float], variables: Mapping[str, Variable]) -> str:
    shown = [f"{name} = {value:g}{_unit(variables.get(name))}" for name, value in inputs.items()]
    more = f" and {len(shown) - _INPUTS_SHOWN} more" if len(shown) > _INPUTS_SHOWN else ""
    return f"Its inputs: {', '.join(shown[:_INPUTS_SHOWN])}{more}."


def _unit(variable: Variable | None) -> str:
    unit = variable.unit if variable is not None else None
    return "" if unit is None or unit.name in ("", "1") else f" {unit.name}"
