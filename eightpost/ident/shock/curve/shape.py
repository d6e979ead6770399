"""What a curve may do: anything, rise only (monotone), or push against the motion only (passive)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import WorkingBasis

    Array = NDArray[np.float64]

#: `auto`: free, and held from falling only where the free curve would fall notably.
Shape = Literal["auto", "free", "monotone", "passive"]

#: A law that needs a rising curve has it rise by at least this share of its mean slope, everywhere.
_LEAST_RISE = 0.01

#: How far inside a held curve stays, of its range of force: rounding must not let it out.
_CLEAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """What a curve b is held to: matrix @ b >= floor.

    Attributes:
        matrix: (J, n): rises from point to point of a grid, or forces against the motion there [N].
        floor: (J,) [N].
        clear: How far inside the floor it is held [N].
    """

    matrix: Array
    floor: Array
    clear: float

    def shortfall(self, b: Array) -> Array:
        """Return by how much (J,) a curve breaks what it is held to [N]."""
        return np.asarray(np.maximum(self.floor - self.matrix @ b, 0.0))

    def touched(self, b: Array) -> Array:
        """Return the rows (T, n) of the matrix that a curve leans on."""
        return self.matrix[self.matrix @ b < self.floor + 2.0 * self.clear]


def hold_for(basis: WorkingBasis, b: Array, shape: Shape) -> Hold:
    """Return what keeps a curve monotone or passive; b is that curve before."""
    sign = np.where(basis.grid > 0.0, 1.0, -1.0)
    matrix = sign[:, None] * basis.grid_columns if shape == "passive" else basis.rises
    return Hold(matrix, np.zeros(matrix.shape[0]), _clear(basis, b))


def rising_hold(basis: WorkingBasis, b: Array) -> Hold:
    """Return what keeps a curve rising all over, by a share of the mean slope of a curve b."""
    slope = max(float(np.sum(basis.rises @ b)), 0.0) / float(np.ptp(basis.grid))
    return Hold(basis.rises, _LEAST_RISE * slope * np.diff(basis.grid), _clear(basis, b))


def _clear(basis: WorkingBasis, b: Array) -> float:
    return _CLEAR * float(np.ptp(basis.grid_columns @ b))


def deepest_fall(basis: WorkingBasis, b: Array) -> float:
    """Return the most that a curve falls while the velocity rises, over its whole range of force [1]."""
    force = basis.grid_columns @ b
    return float((np.maximum.accumulate(force) - force).max() / np.ptp(force))
