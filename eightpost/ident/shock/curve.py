"""Static curve of a fit: its basis functions, the fitted curve, and a curve through given points."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.optimize import isotonic_regression

from eightpost.array_types import Array
from eightpost.shock import StaticCurve
from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER

# ==== Basis of a rising curve through knots: the force is quadratic between them (I-splines) =========================

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


# ==== The fitted curve ===============================================================================================

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
    return np.asarray(np.vstack([value, chord, np.zeros((OUTER_ORDER - 1, INNER_ORDER))]), dtype=np.float64)


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


def curve_forces(curve: StaticCurve, velocity: Array) -> Array:
    """Return F_s (N,) [N] at damper velocities (N,) [m/s]: `StaticCurve.force` for arrays, straight ends included."""
    fitted = np.clip(velocity, -curve.rebound_speed, curve.compression_speed)
    beyond = velocity - fitted
    slope = np.where(beyond > 0.0, curve.compression_slope, curve.rebound_slope)
    if curve.has_knots:
        force = CubicHermiteSpline(curve.knot_velocity, curve.knot_force, curve.knot_slope)(fitted)
    else:
        basis = CurveBasis(curve.transition_speed, curve.transition_width)
        force = basis.design(fitted) @ np.array((*curve.inner, *curve.compression, *curve.rebound))
    return np.asarray(force + slope * beyond, dtype=np.float64)


# ---- Conversion of fitted coefficients to a static curve ------------------------------------------------------------

#: Last part of a side's range, from which the robust end slope is computed.
_LAST_PART = 0.2

#: The polynomial's own end slope is used while it is within this factor of the robust one.
_REASONABLE = 2.0

#: A curve is reported as falling where it falls by more than this share of its range of force.
_NOTABLE_FALL = 1e-3


def fitted_curve(basis: CurveBasis | KnotBasis, coefficients: Array, velocity: Array) -> tuple[StaticCurve, list[str]]:
    """Return the curve of coefficients (C,) with straight ends, and warnings."""
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


# ==== A curve through given points: Fritsch and Carlson's monotone interpolant (PCHIP) ===============================

#: Number of points on each side that a static curve can pass through.
MOST_POINTS = KNOTS // 2

#: Number of velocities in each cell between points at which a candidate cell is compared with the interpolant.
_PLACES = 8

#: Maximum number of points on a side among which the best are searched; of more, evenly spread ones are candidates.
_MOST_CANDIDATES = 120


def curve_through(velocity: Array, force: Array) -> tuple[StaticCurve, PchipInterpolator]:
    """Return the curve through points, and the monotone interpolant of all points that it represents.

    With up to 12 points on each side the curve is the interpolant. With more, it passes through the 12 points between
    which cubics with the interpolant's slopes follow it best.

    Args:
        velocity: Velocities (M,) [m/s], ascending, with 0 and points on both sides of it.
        force: Forces (M,) [N] that nowhere fall, 0 at zero velocity; `held` makes them so.
    """
    joined = PchipInterpolator(velocity, force)
    zero = int(np.searchsorted(velocity, 0.0))
    rebound = _kept(joined, -velocity[zero::-1], -1.0)
    compression = _kept(joined, velocity[zero:], 1.0)
    knots = np.concatenate([_filled(-rebound[::-1]), _filled(compression)[1:]])
    chosen = np.concatenate([-rebound[:0:-1], compression])
    slopes = np.maximum(joined(chosen, 1), 0.0)
    spline = CubicHermiteSpline(chosen, joined(chosen), slopes)
    forces = spline(knots)
    forces[KNOTS // 2] = 0.0
    rising = np.maximum(spline(knots, 1), 0.0)
    return StaticCurve.through_knots(*(tuple(values.tolist()) for values in (knots, forces, rising))), joined


def held(velocity: Array, force: Array) -> Array:
    """Return the forces (M,) [N] that nowhere fall and are closest to given ones by least squares; 0 at zero velocity.

    Means over neighbours that fall (pool adjacent violators), and none with the wrong sign for its stroke. They are
    rounded to 1e-9 N, because harmonic means of smaller differences overflow in the interpolant.
    """
    sides = velocity < 0.0, velocity > 0.0
    found = np.zeros_like(force)
    for side, low, high in zip(sides, (-np.inf, 0.0), (0.0, np.inf), strict=True):
        found[side] = np.clip(isotonic_regression(force[side]).x, low, high)
    return np.round(found, 9)


def _filled(knots: Array) -> Array:
    """Return the knots of a side (13,): its widest cells are halved, where the same cubic continues."""
    while knots.size <= MOST_POINTS:
        widest = int(np.argmax(np.diff(knots)))
        knots = np.insert(knots, widest + 1, 0.5 * (knots[widest] + knots[widest + 1]))
    return knots


def _kept(joined: PchipInterpolator, speeds: Array, side: float) -> Array:
    """Return zero and the speeds of a side (at most 13,) that become knots."""
    if speeds.size <= MOST_POINTS + 1:
        return speeds
    if speeds.size > _MOST_CANDIDATES:
        speeds = speeds[np.unique(np.linspace(0, speeds.size - 1, _MOST_CANDIDATES).astype(int))]
    return speeds[_shortest_path(_cell_costs(joined, speeds, side), MOST_POINTS)]


def _cell_costs(joined: PchipInterpolator, speeds: Array, side: float) -> Array:
    """Return the error (K, K) of a cubic from each speed to each higher one: integral of its square [N2.m/s].

    A cubic that falls costs more than any other.
    """
    count = speeds.size
    force, slope = side * joined(side * speeds), np.maximum(joined(side * speeds, 1), 0.0)
    share = (np.arange(_PLACES) + 0.5) / _PLACES
    places = (speeds[:-1, None] + np.diff(speeds)[:, None] * share).ravel()
    weight = np.repeat(np.diff(speeds) / _PLACES, _PLACES)
    target = side * joined(side * places)
    costs = np.full((count, count), np.inf)
    for i in range(count - 1):
        for j in range(i + 1, count):
            here = slice(i * _PLACES, j * _PLACES)
            cubic = CubicHermiteSpline(speeds[[i, j]], force[[i, j]], slope[[i, j]])(places[here])
            costs[i, j] = float(np.sum(weight[here] * (cubic - target[here]) ** 2))
            if np.diff(cubic, prepend=force[i], append=force[j]).min() < 0.0:
                costs[i, j] += float(np.ptp(force) ** 2 * speeds[-1])
    return costs


def _shortest_path(costs: Array, cells: int) -> NDArray[np.intp]:
    """Return the indices (cells + 1,) from the first to the last point with the lowest sum of costs (K, K)."""
    count = costs.shape[0]
    total, before = costs[0].copy(), []
    for _ in range(cells - 1):
        sums = total[:, None] + costs
        before.append(np.argmin(sums, axis=0))
        total = sums[before[-1], np.arange(count)]
    path = [count - 1]
    for origin in reversed(before):
        path.append(int(origin[path[-1]]))
    return np.array([0, *reversed(path)], dtype=np.intp)
