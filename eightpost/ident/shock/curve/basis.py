"""The static curve as a matrix: F_s is linear in its coefficients (Eq 3.23), so least squares applies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from eightpost.shock.curve import INNER_ORDER, OUTER_ORDER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.shock import StaticCurve

    Array = NDArray[np.float64]

#: How an outer cubic joins the inner polynomial at the transition.
Join = Literal["free", "value", "slope", "straight"]

#: Coefficients of a curve: inner, compression, rebound.
COEFFICIENTS = INNER_ORDER + 2 * (OUTER_ORDER + 1)
_COMPRESSION, _REBOUND = INNER_ORDER, INNER_ORDER + OUTER_ORDER + 1

#: The straight continuation of a side without data uses the slope of a chord of the inner polynomial over this last
#: share of it, because the end slope of a 15th-order polynomial is not reliable.
_CHORD = 0.1

#: Number of points over the fitted range at which the rise of a curve is checked.
GRID = 401
_BLEND = 25

#: Directions of the scaled design that are weaker than this share of the strongest are dropped.
_WEAKEST = 1e-8


@dataclass(frozen=True, slots=True)
class CurveBasis:
    """The basis functions of a static curve with a given transition.

    Attributes:
        transition_speed: v_t [m/s].
        transition_width: Width of the transition [m/s].
    """

    transition_speed: float
    transition_width: float

    def design(self, velocity: Array) -> Array:
        """Return the matrix (N, 23) whose product with the coefficients (23,) [N] is F_s (N,) [N].

        Columns: (v / v_t)^k, k = 1 .. 15; then ((|v| - v_t) / v_t)^k, k = 0 .. 3, in compression and in rebound;
        each weighted by its share of the blend. The fitted range belongs to the curve and is not used here.

        Args:
            velocity: Damper velocity (N,) [m/s].

        Returns:
            Matrix with contiguous columns.
        """
        share = self.outer_share(np.abs(velocity))
        reach = 1.0 + 0.5 * self.transition_width / self.transition_speed
        inner = _powers(np.clip(velocity / self.transition_speed, -reach, reach), INNER_ORDER)
        outer = _powers(np.abs(velocity) / self.transition_speed - 1.0, OUTER_ORDER)
        sides = [np.where(side, share, 0.0) * outer for side in (velocity > 0.0, velocity <= 0.0)]
        return np.vstack([(1.0 - share) * inner[1:], *sides]).T

    def outer_share(self, speed: Array) -> Array:
        """Return the weight (N,) [1] of the outer cubics at speeds (N,) [m/s], not negative."""
        share = (speed - self.transition_speed) / self.transition_width + 0.5
        return np.asarray(np.clip(share, 0.0, 1.0), dtype=np.float64)

    def ties(self, *, compression: Join, rebound: Join, order: int = INNER_ORDER) -> Array:
        """Return the matrix (23, n) from the free to all coefficients, given how each cubic joins the inner polynomial.

        Args:
            compression: Join of the compression side. `free`; `value`: the cubic starts at the value of the inner
                polynomial; `slope`: at its value and slope; `straight`: a straight line, for a side without data.
            rebound: Join of the rebound side, as for `compression`.
            order: Order of the inner polynomial, 1 to 15.
        """
        ties = np.eye(COEFFICIENTS)
        for start, sign, join in ((_COMPRESSION, 1.0, compression), (_REBOUND, -1.0, rebound)):
            tied = _joined(join, sign)
            ties[start : start + tied.shape[0]] = 0.0
            ties[start : start + tied.shape[0], :INNER_ORDER] = tied
        ties[:, order:INNER_ORDER] = 0.0
        return ties[:, np.abs(ties).sum(axis=0) > 0.0]


def _powers(base: Array, highest: int) -> Array:
    """Return the powers (highest + 1, N) of a base (N,), starting with power 0."""
    powers = np.ones((highest + 1, base.size))
    for k in range(highest):
        np.multiply(powers[k], base, out=powers[k + 1])
    return powers


def _joined(join: Join, sign: float) -> Array:
    """Return the first coefficients of a cubic as (0 .. 4, 15) weights of the inner ones, on a side (+1, -1)."""
    k = np.arange(1, INNER_ORDER + 1)
    value, slope = sign**k, k * sign**k
    if join == "straight":
        chord = (value - ((1.0 - _CHORD) * sign) ** k) / _CHORD
        return np.vstack([value, chord, np.zeros((OUTER_ORDER - 1, INNER_ORDER))])
    return np.vstack([value, slope])[: {"free": 0, "value": 1, "slope": 2}[join]]


@dataclass(frozen=True, slots=True, eq=False)
class WorkingBasis:
    """Orthogonal columns for least squares, and their relation to the curve's coefficients.

    Attributes:
        curve: Functions that the columns combine.
        columns: Orthogonal columns (N, n) of unit root mean square, contiguous in memory.
        grid: Velocities (J,) [m/s]: evenly spaced, and finer in the blend.
        grid_columns: Columns (J, n) at the grid's velocities.
        to_curve: Matrix (23, n): curve coefficients = to_curve @ working coefficients.
    """

    curve: CurveBasis
    columns: Array
    grid: Array
    grid_columns: Array
    to_curve: Array

    @property
    def rises(self) -> Array:
        """The changes of the columns (J - 1, n) from point to point of the grid."""
        return np.diff(self.grid_columns, axis=0)

    def at(self, velocity: Array) -> Array:
        """Return the columns (M, n) at other velocities (M,) [m/s]."""
        return np.asarray(self.curve.design(velocity) @ self.to_curve)


def working_basis(basis: CurveBasis, velocity: Array, ties: Array) -> WorkingBasis:
    """Return the orthogonal basis of a curve at velocities (N,) [m/s] under ties (23, n).

    Singular values of the scaled columns are used, because raw powers would have a condition of 1e5 and more.
    Directions that the data do not determine are dropped.
    """
    design = basis.design(velocity)
    free = design @ ties
    size = np.linalg.norm(free, axis=0)
    used = size > 0.0
    free, scaled_ties = free[:, used] / size[used], ties[:, used] / size[used]
    _, strength, directions = np.linalg.svd(np.linalg.qr(free, mode="r"))
    kept = strength > _WEAKEST * strength[0]
    to_curve = scaled_ties @ (directions[kept].T / strength[kept]) * np.sqrt(design.shape[0])
    grid = _grid(basis, float(velocity.min()), float(velocity.max()))
    columns = np.asfortranarray(design @ to_curve)
    return WorkingBasis(basis, columns, grid, basis.design(grid) @ to_curve, to_curve)


def _grid(basis: CurveBasis, lowest: float, highest: float) -> Array:
    """Return an even grid with finer points in the blend, which is narrower than a few steps of the even grid."""
    blend = basis.transition_speed + basis.transition_width * np.linspace(-1.0, 1.0, _BLEND)
    grid = np.concatenate([np.linspace(lowest, highest, GRID), blend, -blend])
    return np.asarray(np.unique(grid[(grid >= lowest) & (grid <= highest)]))


def split_coefficients(coefficients: Array) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return inner (15), compression (4) and rebound (4) of coefficients (23,) [N]."""
    inner, compression, rebound = np.split(coefficients, (_COMPRESSION, _REBOUND))
    return tuple(inner.tolist()), tuple(compression.tolist()), tuple(rebound.tolist())


def curve_coefficients(curve: StaticCurve) -> Array:
    """Return the coefficients (23,) [N] of a curve, in the order of the design."""
    return np.array((*curve.inner, *curve.compression, *curve.rebound), dtype=np.float64)


def curve_forces(curve: StaticCurve, velocity: Array) -> Array:
    """Return F_s (N,) [N] at damper velocities (N,) [m/s]: `StaticCurve.force` for arrays, straight ends included."""
    basis = CurveBasis(curve.transition_speed, curve.transition_width)
    fitted = np.clip(velocity, -curve.rebound_speed, curve.compression_speed)
    beyond = velocity - fitted
    slope = np.where(beyond > 0.0, curve.compression_slope, curve.rebound_slope)
    return np.asarray(basis.design(fitted) @ curve_coefficients(curve) + slope * beyond, dtype=np.float64)
