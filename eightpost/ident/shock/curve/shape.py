"""Constraints on the shape of a curve: none, monotone, or passive (the force always opposes the motion)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import WorkingBasis

    Array = NDArray[np.float64]

#: `auto`: free; constrained to be monotonic only if the free curve would fall notably.
Shape = Literal["auto", "free", "monotone", "passive"]

#: Minimum slope, as a share of the mean slope, for a law that needs a rising curve.
_LEAST_RISE = 0.01

#: Distance of a constrained curve from its bounds, as a share of its range of force; it covers rounding.
_CLEAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class CurveConstraint:
    """A linear constraint on the coefficients b of a curve: matrix @ b >= floor.

    Attributes:
        matrix: Matrix (J, n) that gives rises from point to point of a grid, or forces against the motion there [N].
        floor: Lower bound (J,) [N].
        clear: Distance that a constrained curve keeps from the floor [N].
    """

    matrix: Array
    floor: Array
    clear: float

    def shortfall(self, b: Array) -> Array:
        """Return the amount (J,) [N] by which a curve violates the constraint."""
        return np.asarray(np.maximum(self.floor - self.matrix @ b, 0.0))

    def active_rows(self, b: Array) -> Array:
        """Return the rows (T, n) of the matrix whose constraints are active for a curve."""
        return self.matrix[self.matrix @ b < self.floor + 2.0 * self.clear]


def shape_constraint(basis: WorkingBasis, b: Array, shape: Shape) -> CurveConstraint:
    """Return the constraint that keeps a curve monotone or passive; b is the unconstrained curve."""
    sign = np.where(basis.grid > 0.0, 1.0, -1.0)
    matrix = sign[:, None] * basis.grid_columns if shape == "passive" else basis.rises
    return CurveConstraint(matrix, np.zeros(matrix.shape[0]), _clear(basis, b))


def rising_constraint(basis: WorkingBasis, b: Array) -> CurveConstraint:
    """Return the constraint that makes a curve rise everywhere, by a share of the mean slope of a curve b."""
    slope = max(float(np.sum(basis.rises @ b)), 0.0) / float(np.ptp(basis.grid))
    return CurveConstraint(basis.rises, _LEAST_RISE * slope * np.diff(basis.grid), _clear(basis, b))


def _clear(basis: WorkingBasis, b: Array) -> float:
    return _CLEAR * float(np.ptp(basis.grid_columns @ b))


def deepest_fall(basis: WorkingBasis, b: Array) -> float:
    """Return the largest fall of a curve with rising velocity, as a share of its range of force [1]."""
    force = basis.grid_columns @ b
    return float((np.maximum.accumulate(force) - force).max() / np.ptp(force))
