"""Static curve of a fit: basis functions, the fitted curve."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from eightpost.array_types import Array
from eightpost.ident.shock.knots import CELLS, KnotBasis
from eightpost.shock import StaticCurve
from eightpost.shock.curve import INNER_ORDER, OUTER_ORDER

# ---- The static curve as a matrix -----------------------------------------------------------------------------------

#: Coefficients of a curve: inner, compression, rebound.
_COEFFICIENTS = INNER_ORDER + 2 * (OUTER_ORDER + 1)
_COMPRESSION, _REBOUND = INNER_ORDER, INNER_ORDER + OUTER_ORDER + 1

#: The straight continuation of a side without data uses the slope of a chord of the inner polynomial over this last
#: share of it, because the end slope of a 15th-order polynomial is not reliable.
_CHORD = 0.1

#: Number of points over the fitted range at which the rise of a curve is checked.
_GRID = 401

#: Directions of the scaled design that are weaker than this share of the strongest are dropped.
_WEAKEST = 1e-8


@dataclass(frozen=True, slots=True)
class CurveBasis:
    """The basis functions of a static curve with a given transition."""

    transition_speed: float  #: v_t [m/s].
    transition_width: float  #: Width of the transition [m/s].

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

    def ties(self, straight: Collection[str]) -> Array:
        """Return the matrix (23, n) from the free to all coefficients.

        Args:
            straight: Sides without data, `compression` or `rebound`, whose cubic is a straight line that continues the
                inner polynomial; on the others it joins the polynomial freely.
        """
        ties = np.eye(_COEFFICIENTS)
        for side, start, sign in (("compression", _COMPRESSION, 1.0), ("rebound", _REBOUND, -1.0)):
            if side in straight:
                ties[start : start + OUTER_ORDER + 1] = 0.0
                ties[start : start + OUTER_ORDER + 1, :INNER_ORDER] = _straight(sign)
        return ties[:, np.abs(ties).sum(axis=0) > 0.0]


def _powers(base: Array, highest: int) -> Array:
    """Return the powers (highest + 1, N) of a base (N,), starting with power 0."""
    powers = np.ones((highest + 1, base.size))
    for k in range(highest):
        np.multiply(powers[k], base, out=powers[k + 1])
    return powers


def _straight(sign: float) -> Array:
    """Return the coefficients of a straight line as (4, 15) weights of the inner ones, on a side (+1, -1)."""
    k = np.arange(1, INNER_ORDER + 1)
    value = sign**k
    chord = (value - ((1.0 - _CHORD) * sign) ** k) / _CHORD
    return np.vstack([value, chord, np.zeros((OUTER_ORDER - 1, INNER_ORDER))])


@dataclass(frozen=True, slots=True, eq=False)
class WorkingBasis:
    """Columns for least squares, and their relation to the curve's coefficients."""

    curve: CurveBasis | KnotBasis  #: Functions that the columns combine, with C coefficients.
    #: Columns (N, n), contiguous in memory: of polynomials orthogonal and of unit root mean square, of a curve through
    #: knots one for each slope.
    columns: Array
    to_curve: Array  #: Matrix (C, n): curve coefficients = to_curve @ working coefficients.
    #: Matrix (P, n): its product with the working coefficients counts like a force error, of the size of the RMS error
    #: over all rows.
    penalty: Array

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
    columns = np.asfortranarray(design @ to_curve)
    return WorkingBasis(basis, columns, to_curve, np.empty((0, to_curve.shape[1])))


def knot_basis(velocity: Array, inside: NDArray[np.bool_], *, cells: int = CELLS) -> WorkingBasis:
    """Return the basis of a curve through knots at velocities (N,) [m/s], of which those `inside` (N,) are fitted."""
    return basis_on(KnotBasis.of(velocity[inside], cells=cells), velocity)


def basis_on(knots: KnotBasis, velocity: Array) -> WorkingBasis:
    """Return the basis of given knots at velocities (N,) [m/s].

    The working coefficients are the slopes times the highest speed [N].
    """
    to_curve = np.eye(knots.count) / knots.speed
    columns = np.asfortranarray(knots.design(velocity) / knots.speed)
    return WorkingBasis(knots, columns, to_curve, knots.penalty() @ to_curve)


def split_coefficients(coefficients: Array) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return inner (15), compression (4) and rebound (4) of coefficients (23,) [N]."""
    inner, compression, rebound = np.split(coefficients, (_COMPRESSION, _REBOUND))
    return tuple(inner.tolist()), tuple(compression.tolist()), tuple(rebound.tolist())


def _curve_coefficients(curve: StaticCurve) -> Array:
    """Return the coefficients (23,) [N] of a curve, in the order of the design."""
    return np.array((*curve.inner, *curve.compression, *curve.rebound), dtype=np.float64)


def curve_forces(curve: StaticCurve, velocity: Array) -> Array:
    """Return F_s (N,) [N] at damper velocities (N,) [m/s]: `StaticCurve.force` for arrays, straight ends included."""
    fitted = np.clip(velocity, -curve.rebound_speed, curve.compression_speed)
    beyond = velocity - fitted
    slope = np.where(beyond > 0.0, curve.compression_slope, curve.rebound_slope)
    if curve.has_knots:
        force = CubicHermiteSpline(curve.knot_velocity, curve.knot_force, curve.knot_slope)(fitted)
    else:
        basis = CurveBasis(curve.transition_speed, curve.transition_width)
        force = basis.design(fitted) @ _curve_coefficients(curve)
    return np.asarray(force + slope * beyond, dtype=np.float64)


# ---- Conversion of fitted coefficients to a static curve ------------------------------------------------------------

#: Last part of a side's range, from which the robust end slope is computed.
_LAST_PART = 0.2

#: The polynomial's own end slope is used while it is within this factor of the robust one.
_REASONABLE = 2.0

#: A curve is reported as falling where it falls by more than this share of its range of force.
_NOTABLE_FALL = 1e-3


def fitted_curve(basis: CurveBasis | KnotBasis, coefficients: Array, velocity: Array) -> tuple[StaticCurve, list[str]]:
    """Return the curve of coefficients (C,) with straight ends, and warnings.

    Args:
        basis: Basis functions of the curve.
        coefficients: Coefficients in the order of the design.
        velocity: All velocities (N,) of the fit [m/s]; their range becomes the fitted range of polynomials.
    """
    if isinstance(basis, KnotBasis):
        return basis.static_curve(coefficients), []
    highest, lowest = float(velocity.max()), float(velocity.min())
    compression_slope, why_compression = _end_slope(basis, coefficients, highest)
    rebound_slope, why_rebound = _end_slope(basis, coefficients, lowest)
    inner, compression, rebound = split_coefficients(coefficients)
    curve = StaticCurve(
        inner=inner,
        compression=compression,
        rebound=rebound,
        transition_speed=basis.transition_speed,
        transition_width=basis.transition_width,
        compression_speed=highest,
        rebound_speed=-lowest,
        compression_slope=compression_slope,
        rebound_slope=rebound_slope,
    )
    return curve, [*why_compression, *why_rebound, *_turns(basis, coefficients, lowest, highest)]


def _end_slope(basis: CurveBasis, coefficients: Array, end: float) -> tuple[float, list[str]]:
    """Return the slope beyond a signed end of the range [N.s/m], and a warning if it is not the polynomial's own.

    The last slope of a polynomial depends on few samples. If it differs too much from the robust (Theil-Sen) slope of
    the curve's last fifth, the robust slope is used; if that is negative too, the chord from the transition.
    """
    from scipy.stats import theilslopes  # noqa: PLC0415 -- takes half a second to load, and only recipe boggs needs it

    velocity = np.linspace(1.0 - _LAST_PART, 1.0, 41) * end
    force = basis.design(velocity) @ coefficients
    own = float((force[-1] - force[-2]) / (velocity[-1] - velocity[-2]))
    robust = float(theilslopes(force, velocity).slope)
    if robust > 0.0 and robust / _REASONABLE <= own <= robust * _REASONABLE:
        return own, []
    start = float(np.copysign(min(basis.transition_speed, 0.5 * abs(end)), end))
    chord = float((force[-1] - basis.design(np.array([start]))[0] @ coefficients) / (end - start))
    slope = robust if robust > 0.0 else max(chord, 0.0)
    return slope, [
        f"the curve's slope at {end:.3g} m/s, the end of the range, is {own:.4g} N.s/m and that of its last fifth "
        f"{robust:.4g}: beyond the range the curve continues with {slope:.4g}; few samples lie there"
    ]


def _turns(basis: CurveBasis, coefficients: Array, lowest: float, highest: float) -> list[str]:
    """Return a warning with the velocities between which the force falls with rising velocity."""
    velocity = np.linspace(lowest, highest, _GRID)
    force = basis.design(velocity) @ coefficients
    drop = np.maximum.accumulate(force) - force
    if drop.max() <= _NOTABLE_FALL * np.ptp(force):
        return []
    falls = np.flatnonzero(np.diff(force) < 0.0)
    runs = np.split(falls, np.flatnonzero(np.diff(falls) > 1) + 1)
    notable = [run for run in runs if force[run[0]] - force[run[-1] + 1] > 0.1 * _NOTABLE_FALL * np.ptp(force)]
    places = ", ".join(f"{velocity[run[0]]:.3g} to {velocity[run[-1] + 1]:.3g} m/s" for run in notable)
    return [f"the fitted curve is not monotone: the force falls from {places}, by up to {drop.max():.3g} N"]
