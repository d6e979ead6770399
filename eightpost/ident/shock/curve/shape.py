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

#: A violation by 1 N costs as much as a force error of this many N all along.
_PRICE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """A price on a curve b wherever (matrix @ b) / size is below a margin.

    Attributes:
        matrix: (J, n): rises from point to point of a grid, or forces against the motion there [N].
        price: Of 1 N in the residual [1].
        floor: (J,) what matrix @ b is held to [N].
        margin: (J,) what is kept clear beyond it [N]: it makes up for a price being no wall.
    """

    matrix: Array
    price: float
    floor: Array
    margin: Array

    def residual(self, b: Array) -> Array:
        """Return the priced violations (J,)."""
        return np.asarray(self.price * np.minimum(self.matrix @ b - self.floor - self.margin, 0.0))

    def jacobian(self, b: Array) -> Array:
        """Return their derivative (J, n)."""
        active = self.matrix @ b < self.floor + self.margin
        return np.where(active, self.price, 0.0)[:, None] * self.matrix

    def shortfall(self, b: Array) -> Array:
        """Return by how much (J,) the curve itself breaks what it is held to [N]."""
        return np.asarray(np.maximum(self.floor - self.matrix @ b, 0.0))


def hold_for(basis: WorkingBasis, shape: Shape, *, rows: int) -> Hold:
    """Return the price that keeps a curve monotone or passive, in a problem of a number of rows."""
    sign = np.where(basis.grid > 0.0, 1.0, -1.0)
    matrix = sign[:, None] * basis.grid_columns if shape == "passive" else basis.rises
    clear = np.zeros(matrix.shape[0])
    return Hold(matrix, _PRICE * float(np.sqrt(rows)), clear, clear)


def rising_hold(basis: WorkingBasis, b: Array, *, rows: int) -> Hold:
    """Return the price that keeps a curve rising all over, by a share of the mean slope of a curve b."""
    slope = max(float(np.sum(basis.rises @ b)), 0.0) / float(np.ptp(basis.grid))
    least = _LEAST_RISE * slope * np.diff(basis.grid)
    return Hold(basis.rises, _PRICE * float(np.sqrt(rows)), least, np.zeros(least.size))


def deepest_fall(basis: WorkingBasis, b: Array) -> float:
    """Return the most that a curve falls while the velocity rises, over its whole range of force [1]."""
    force = basis.grid_columns @ b
    return float((np.maximum.accumulate(force) - force).max() / np.ptp(force))
