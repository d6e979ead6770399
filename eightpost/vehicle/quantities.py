"""Vehicle parameters: dataclass fields with unit and range, and values per corner."""

from __future__ import annotations

from dataclasses import MISSING, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Corners(NamedTuple):
    """Values per corner."""

    lf: float
    rf: float
    lr: float
    rr: float

    @classmethod
    def same(cls, value: float) -> Corners:
        """Return the same value for all four corners."""
        return cls(value, value, value, value)

    @classmethod
    def axles(cls, front: float, rear: float) -> Corners:
        """Return the same value for both corners of an axle."""
        return cls(front, front, rear, rear)


def positive(unit: str, *, default: Any = MISSING) -> Any:
    """Declare a parameter in `unit` that must be above zero."""
    return field(default=default, metadata={"unit": unit, "above": 0.0})


def not_negative(unit: str, *, default: Any = MISSING) -> Any:
    """Declare a parameter in `unit` that must not be below zero."""
    return field(default=default, metadata={"unit": unit, "least": 0.0})


def anywhere(unit: str, *, default: Any = MISSING) -> Any:
    """Declare a parameter in `unit` that may have either sign."""
    return field(default=default, metadata={"unit": unit})


def check_ranges(parameters: Any) -> None:
    """Check every declared parameter of a dataclass against its range.

    Raises:
        ParameterError: A value is not finite or outside its range; the message names the parameter.
    """
    for declared in fields(parameters):
        value = getattr(parameters, declared.name)
        if value is None:
            continue
        named = value._asdict().items() if isinstance(value, Corners) else (("", value),)
        for corner, number in named:
            _check(
                f"{declared.name}.{corner}" if corner else declared.name,
                float(number),
                dict(declared.metadata),
            )


def _check(name: str, value: float, declared: dict[str, Any]) -> None:
    unit = declared["unit"]
    if not np.isfinite(value):
        raise ParameterError(f"{name} is {value}; give a finite number [{unit}]")
    if "above" in declared and value <= declared["above"]:
        raise ParameterError(f"{name} is {value:g} {unit}; it must be above zero")
    if "least" in declared and value < declared["least"]:
        raise ParameterError(f"{name} is {value:g} {unit}; it must not be negative")


def check_static(static: Mapping[str, float], outputs: Sequence[str], where: str) -> dict[str, float]:
    """Return a copy of a static state after checking that each value is finite and belongs to an output.

    Raises:
        ParameterError: A value is not finite, or its output does not exist or has no static part.
    """
    with_static = [name for name in outputs if name.endswith(("tire_force", "ride_height"))]
    for name, value in static.items():
        if name not in with_static:
            raise ParameterError(
                f"{where}: a static value is given for {name!r}; this model has static values of "
                f"{', '.join(with_static)}"
            )
        if not np.isfinite(value):
            raise ParameterError(f"{where}: the static {name} is {value}; give a finite number")
    return {name: float(value) for name, value in static.items()}
