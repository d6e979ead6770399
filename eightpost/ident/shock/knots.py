"""Basis of a rising curve through knots: the slope is linear between them, so the force is quadratic (I-splines)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.shock import StaticCurve
from eightpost.shock.curve import KNOTS

#: Number of cells on each side; `StaticCurve` has 12, into which these are subdivided without a change of the curve.
#: With 12 the held-out errors are 1.4 % smaller, but a narrow cell at zero velocity and the gas force have almost the
#: same effect, and the preload of a shock that LPNL2 does not describe exactly is wrong by 80 N
#: (docs/explanation/static_curve.md).
CELLS = 6

#: Exponent of the knots' spacing: knots at V (j / cells)^1.8 are dense at low speed, where the curve bends most.
_SPACING = 1.8

#: Penalties on slope times V, as shares of the RMS force error: on its size, on its changes from knot to knot, and on
#: the change of its bend at the beginning of the last cell of each side, which has few samples and determines the slope
#: beyond. The first two determine cells without data and have almost no effect on others. Without the third, the error
#: of LPNL2 from a slow run to a fast one is 68 % instead of 33 % (docs/explanation/static_curve.md).
RIDGE, CHANGE, END_BEND = 1e-4, 3e-4, 3e-2


@dataclass(frozen=True, slots=True)
class KnotBasis:
    """Functions of a curve whose coefficients are its slopes at the knots, 0 at zero velocity.

    The curve rises everywhere if no slope is negative. Beyond the knots it continues as a straight line.
    """

    knots: tuple[float, ...]  #: Velocities of the knots (K,) [m/s], ascending; the middle one is 0.

    @classmethod
    def of(cls, velocity: Array, *, cells: int = CELLS) -> KnotBasis:
        """Return the basis for the range of velocities (N,) [m/s] of both signs, with `cells` cells on each side."""
        shares = (np.arange(1, cells + 1) / cells) ** _SPACING
        rebound, compression = float(velocity.min()) * shares[::-1], float(velocity.max()) * shares
        return cls((*rebound.tolist(), 0.0, *compression.tolist()))

    @property
    def count(self) -> int:
        """Number K of knots."""
        return len(self.knots)

    @property
    def speed(self) -> float:
        """Highest speed of the knots [m/s]."""
        return max(-self.knots[0], self.knots[-1])

    def design(self, velocity: Array) -> Array:
        """Return the matrix (N, K) whose product with the slopes (K,) [N.s/m] is F_s (N,) [N].

        Args:
            velocity: Damper velocity (N,) [m/s].

        Returns:
            Matrix with contiguous columns.
        """
        knots, samples = np.array(self.knots), np.arange(velocity.size)
        inside = np.clip(velocity, knots[0], knots[-1])
        cell = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, knots.size - 2)
        along = inside - knots[cell]
        second = along**2 / (2.0 * np.diff(knots)[cell])
        columns = self._forces_of_slopes().T[:, cell]
        columns[cell, samples] += along - second
        columns[cell + 1, samples] += second
        columns[0] += np.minimum(velocity - knots[0], 0.0)
        columns[-1] += np.maximum(velocity - knots[-1], 0.0)
        return np.asarray(columns.T)

    def _forces_of_slopes(self) -> Array:
        """Return the matrix (K, K) from slopes to forces at the knots: each cell rises by its mean slope."""
        count, widths = self.count, np.diff(self.knots)
        rises = np.zeros((count, count))
        rises[np.arange(1, count), np.arange(count - 1)] = rises[np.arange(1, count), np.arange(1, count)] = (
            0.5 * widths
        )
        forces = np.cumsum(rises, axis=0)
        return np.asarray(forces - forces[count // 2])

    def penalty(self) -> Array:
        """Return the rows (2 K + 1, K) whose product with the slopes is added to the force error [N], over its size.

        The last two rows are 0 if the slope changes at the same rate in the last two cells of each side.
        """
        unit = self.speed * np.eye(self.count)
        changes = np.diff(unit, axis=0)
        return np.vstack([RIDGE * unit, CHANGE * changes, END_BEND * self._end_bends(changes)])

    def _end_bends(self, changes: Array) -> Array:
        """Return the rows (2, K): changes in the last cells, less those at the rates of the cells next to them."""
        widths = np.diff(self.knots)
        last, before = [0, -1], [1, -2]
        return np.asarray(changes[last] - changes[before] * (widths[last] / widths[before])[:, None])

    def subdivided(self, slopes: Array) -> tuple[Array, Array, Array]:
        """Return velocities [m/s], forces [N] and slopes [N.s/m] (25,) of the same curve on the knots of `StaticCurve`.

        Cells are halved, the widest first; a quadratic is the same on both halves.
        """
        middle = self.count // 2
        sides = (_halved(self.knots[: middle + 1]), _halved(self.knots[middle:])[1:])
        velocity = np.concatenate(sides)
        fine = np.interp(velocity, self.knots, np.maximum(slopes, 0.0))
        return velocity, KnotBasis(tuple(velocity.tolist()))._forces_of_slopes() @ fine, fine

    def static_curve(self, slopes: Array) -> StaticCurve:
        """Return the curve of slopes (K,) [N.s/m]; beyond the knots it continues with the slopes of their ends."""
        velocity, force, slope = self.subdivided(slopes)
        return StaticCurve.through_knots(tuple(velocity.tolist()), tuple(force.tolist()), tuple(slope.tolist()))


def _halved(knots: tuple[float, ...]) -> Array:
    """Return the knots of one side with their widest cells halved until there are as many as `StaticCurve` has."""
    found = np.array(knots)
    while found.size <= KNOTS // 2:
        widest = int(np.argmax(np.diff(found)))
        found = np.insert(found, widest + 1, 0.5 * (found[widest] + found[widest + 1]))
    return found
