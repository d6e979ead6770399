"""Structural vehicles: parameters with unit and range, and the state space of equations of motion."""

from __future__ import annotations

from dataclasses import MISSING, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.vehicle.statespace import Channel, StateSpace

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


# ---- Parameters: dataclass fields with unit and range, and values per corner ----------------------------------------


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


# ---- Equations of motion as a state space with named outputs --------------------------------------------------------


def state_matrices(mass: Array, damping: Array, stiffness: Array, load: Array) -> tuple[Array, Array]:
    """Return A and B of `x' = A x + B u` with `x = (q, q')` for `M q'' + C q' + K q = L u`.

        A = [[0, I], [-M^-1 K, -M^-1 C]],    B = [[0], [M^-1 L]]

    The mass matrix is diagonal, so zeros of K, C and L are exact zeros of A and B.

    Args:
        mass: Diagonal of the mass matrix M (n,).
        damping: Damping matrix C (n, n).
        stiffness: Stiffness matrix K (n, n).
        load: Input matrix L (n, m).

    Source: dissertation Eq 4.2 and 5.19.
    """
    n = len(mass)
    inverse = 1.0 / mass[:, None]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * stiffness, -inverse * damping]])
    return A, np.vstack([np.zeros_like(load), inverse * load])


class Outputs:
    """Builder of output equations, one group of rows after the other."""

    def __init__(self, A: Array, B: Array) -> None:
        """Store the matrices A (2n, 2n) and B (2n, m) of the state equation."""
        self._A, self._B = A, B
        self._n = len(A) // 2
        self._channels: list[Channel] = []
        self._C: list[Array] = []
        self._D: list[Array] = []

    def add(self, names: Sequence[str], unit: str, C: Array, D: Array | None = None) -> None:
        """Add rows `y = C x + D u`, with C (k, 2n) and D (k, m) or none."""
        self._channels += [Channel(name, unit) for name in names]
        self._C.append(C)
        self._D.append(np.zeros((len(C), self._B.shape[1])) if D is None else D)

    def add_position(self, names: Sequence[str], unit: str, rows: Array, D: Array | None = None) -> None:
        """Add `y = rows q + D u`, with rows (k, n)."""
        self.add(names, unit, np.hstack([rows, np.zeros_like(rows)]), D)

    def add_velocity(self, names: Sequence[str], unit: str, rows: Array) -> None:
        """Add `y = rows q'`, which depends on the state alone."""
        self.add(names, unit, np.hstack([np.zeros_like(rows), rows]))

    def add_acceleration(self, names: Sequence[str], unit: str, rows: Array) -> None:
        """Add `y = rows q''`, from the lower half of the state equation, with its direct terms."""
        self.add(names, unit, rows @ self._A[self._n :], rows @ self._B[self._n :])

    def model(self, inputs: Iterable[Channel], name: str) -> StateSpace:
        """Return the state space with all outputs added so far."""
        return StateSpace(
            self._A,
            self._B,
            np.vstack(self._C),
            np.vstack(self._D),
            tuple(inputs),
            tuple(self._channels),
            None,
            name,
        )
