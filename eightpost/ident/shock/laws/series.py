"""Maxwell's law in the fit: stepped by its own functions, with derivatives from its equation.

With F = f(w) and dF/dt = k (v - w), a change D of the force obeys, to first order,

    tau dD/dt = change of f at w - D + f'(w) (v - w) dk/k,   tau = f'(w) / k

This is a first-order lag with varying time constant: one pass over the record gives the derivatives by all parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.shock.laws.compiled import lagged_columns
from eightpost.ident.shock.laws.stepped import SteppedLaw

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import WorkingBasis
    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]

#: Points of the velocity table. Between them the curve is treated as straight, accurate to a hundredth of a newton.
_TABLE = 4001


class _TablePoint(NamedTuple):
    """Result of a table look-up: velocities w (N,) [m/s], slopes f'(w) (N,) [N.s/m], columns at w (N, n)."""

    velocity: Array
    slope: Array
    columns: Array


@dataclass(frozen=True)
class SeriesSpring(SteppedLaw):
    """Maxwell: theta = (ln k,), k [N/m] the stiffness in series with the valves."""

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives by one pass of a varying lag over the curve's columns at w."""
        point, stiffness = _look_up(model.basis, b, self.force(model, b, theta)), float(np.exp(theta[0]))
        strain = point.slope * (model.runs.velocity - point.velocity)
        columns = np.vstack([point.columns.T, strain]).T
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        lagged = [lagged_columns(columns[part], point.slope[part] / stiffness, p.step) for p, part in pairs]
        rows = model.runs.rows(np.concatenate(lagged).T).T
        return rows[:, :-1], rows[:, -1:]

    def like_lpf1(self, model: ForceModel, lpf1: Array) -> Array:
        """Return ln k with k = slope / tau, where slope is the mean slope of the curve over the samples."""
        b = lpf1[: model.curve_count]
        slope = _look_up(model.basis, b, model.static(b)).slope
        low, high = self.bounds()
        return np.clip(np.log([float(slope.mean()) / float(lpf1[-1])]), low, high)


@lru_cache(maxsize=4)
def _grid(basis: WorkingBasis) -> tuple[Array, Array]:
    """Return the table's velocities (M,) [m/s] and the basis's columns there (M, n)."""
    velocity = np.linspace(basis.grid[0], basis.grid[-1], _TABLE)
    return velocity, np.asfortranarray(basis.at(velocity))


def _rising(basis: WorkingBasis, b: Array) -> Array:
    """Return rising forces (M,) [N] of a curve b at the grid; a curve may fall during the fit, the result does not."""
    _, columns = _grid(basis)
    return np.asarray(np.maximum.accumulate(columns @ b) + 1e-9 * np.arange(_TABLE))


def _look_up(basis: WorkingBasis, b: Array, force: Array) -> _TablePoint:
    """Look forces (N,) [N] up on a curve b."""
    velocity, columns = _grid(basis)
    slope = np.maximum(np.gradient(columns @ b, velocity), 1.0)
    place = np.interp(force, _rising(basis, b), np.arange(float(_TABLE)))
    cell = np.minimum(place.astype(np.intp), _TABLE - 2)
    share = place - cell
    series = np.take(columns.T, cell, axis=1) * (1.0 - share) + np.take(columns.T, cell + 1, axis=1) * share
    between = velocity[0] + place * (velocity[1] - velocity[0])
    return _TablePoint(between, slope[cell] * (1.0 - share) + slope[cell + 1] * share, series.T)
