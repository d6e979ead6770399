"""Conversion of equations of motion to a state space with named outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.vehicle.statespace import Channel, StateSpace

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


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
