"""The shape that comes closest to a curve: least squares of the force, both sides at once.

Both sides share the slope at rest, so neither can be fitted alone. The force is linear in the slopes at the knots, and
these are linear in all numbers but the knee speeds v_k (2,):

    F = M(v_k) p,   p = (bleed, low, high, rise) of both sides (8,)

Linear fits at pairs of knee speeds give the starts, from which all ten numbers are searched with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares, nnls

from eightpost.array_types import Array
from eightpost.shock.curve import StaticCurve
from eightpost.shock.law import ShockLaw
from eightpost.shock.lpf1 import Lpf1
from eightpost.shock.lpnl2 import Lpnl2
from eightpost.shock.shape import BLEED_SHARE, REACH, SHARES, UNITS, Shape, Side, slope_weights

#: Number of speeds of a side at which a shape is compared with a curve.
_COMPARED = 80

#: Those speeds, as shares of the highest [1]: at equal steps of their root.
_SPEEDS = np.linspace(0.0, 1.0, _COMPARED + 1)[1:] ** 2

#: Bounds of each number of a side [SI].
BOUNDS = {
    "bleed": (200.0, 3e4),
    "low": (200.0, 3e4),
    "knee": (0.02, 0.4),
    "high": (50.0, 2e4),
    "rise": (1.0, 1e4),
}

#: The same as logarithms (10, 2), and their middles (10,).
_BOUNDS = np.log([BOUNDS[name] for name in UNITS] * 2)
_MIDDLE = _BOUNDS.mean(axis=1)

#: Places of the knee speeds among the ten numbers, and of those that the slope is linear in.
_KNEE = np.flatnonzero([name == "knee" for name in UNITS] * 2)
_LINEAR = np.flatnonzero([name != "knee" for name in UNITS] * 2)

#: Knee speeds of the linear fits of each side [m/s].
_KNEES = np.geomspace(0.025, 0.39, 8)

#: Weight of the distance from the middle of the bounds, as a share of the RMS force: a number that the curve does not
#: determine stays in the middle.
_PULL = 1e-3

#: Speeds of the knots of a side (K,) [m/s].
_KNOTS = REACH * SHARES


@dataclass(frozen=True, slots=True)
class ShapeFit:
    """The shape that comes closest to a curve."""

    shape: Shape  #: Shape; a curve alone gives the default lag and gas.
    residual: float  #: RMS difference of the forces over both sides [N].
    relative: float  #: The same as a share of the curve's RMS force [1].


def fit_law(law: ShockLaw) -> ShapeFit:
    """Fit a shape to a law: its static curve, its gas force, and the lag of LPF1 and LPNL2; others get the default lag.

    The residual is that of the static curve.
    """
    port, curve = law.port, law.curve
    ends = min(REACH, curve.compression_speed), min(REACH, curve.rebound_speed)
    found = fit_force(lambda velocity: port.scale(velocity) * curve.force(velocity), *ends)
    shape = replace(found.shape, gas=port.gas_preload)
    if isinstance(law, Lpf1 | Lpnl2):
        shape = replace(shape, lag=law.time_constant)
    if isinstance(law, Lpnl2):
        shape = replace(shape, lag_force=law.lag_zero_force)
    return replace(found, shape=shape)


def fit_shape(curve: StaticCurve, reach: float = REACH) -> ShapeFit:
    """Fit a shape to a curve by least squares of the force, at equal steps of the root of the speed.

    Args:
        curve: Curve to fit, with or without knots.
        reach: Highest speed to compare [m/s]; the curve's fitted range limits it.
    """
    return fit_force(curve.force, min(reach, curve.compression_speed), min(reach, curve.rebound_speed))


def fit_force(force: Callable[[float], float], compression_speed: float, rebound_speed: float) -> ShapeFit:
    """Fit a shape to a force [N] over velocity [m/s], as `fit_shape`, up to a speed of each side [m/s]."""
    speeds = np.stack([compression_speed * _SPEEDS, rebound_speed * _SPEEDS])
    forces = np.array([[force(v) for v in speeds[0].tolist()], [-force(-v) for v in speeds[1].tolist()]])
    scales = np.sqrt(np.mean(forces**2, axis=1))  # each side counts by its own force
    problem = _Problem(_force_weights(speeds) / scales.repeat(_COMPARED)[:, None], (forces / scales[:, None]).ravel())
    numbers = problem.solution()
    errors = problem.errors(numbers).reshape(2, -1) * scales[:, None]
    compression, rebound = (Side(*side) for side in np.exp(numbers).reshape(2, -1).tolist())
    rms = float(np.sqrt(np.mean(errors**2)))
    return ShapeFit(Shape(compression, rebound), rms, rms / float(np.sqrt(np.mean(forces**2))))


@dataclass(frozen=True)
class _Problem:
    """Forces of both sides to fit; N speeds of each side, K knots."""

    weights: Array  #: Weight of the slope at each knot of both sides in each force (2 N, 2 K).
    forces: Array  #: Forces (2 N,).

    def errors(self, numbers: Array) -> Array:
        """Return the errors (2 N,) of the logarithms of the numbers of both sides (10,)."""
        return self._design(np.exp(numbers[_KNEE])) @ np.exp(numbers[_LINEAR]) - self.forces

    def solution(self) -> Array:
        """Return the logarithms of the numbers (10,) with the smallest errors."""
        low, high = _BOUNDS.T
        ends = [
            least_squares(self._residuals, start, self._jacobian, (low, high), x_scale="jac")
            for start in self._starts()
        ]
        return np.asarray(min(ends, key=lambda end: float(end.cost)).x)

    def _starts(self) -> list[Array]:
        """Return the numbers (10,) of the linear fits that are the best among their neighbours, inside the bounds."""
        pairs = np.stack(np.meshgrid(_KNEES, _KNEES, indexing="ij"), axis=-1).reshape(-1, 2)
        fits = [nnls(self._design(knees), self.forces) for knees in pairs]
        errors = np.reshape([error for _, error in fits], (_KNEES.size, _KNEES.size))
        lowest = np.flatnonzero(errors == minimum_filter(errors, 3))
        found = np.empty((lowest.size, _BOUNDS.shape[0]))
        found[:, _KNEE] = np.log(pairs[lowest])
        found[:, _LINEAR] = np.log(np.maximum([fits[place][0] for place in lowest], 1e-9))
        return list(np.clip(found, _BOUNDS[:, 0] + 0.02, _BOUNDS[:, 1] - 0.02))

    def _residuals(self, numbers: Array) -> Array:
        return np.concatenate([self.errors(numbers), _PULL * (numbers - _MIDDLE)])

    def _jacobian(self, numbers: Array) -> Array:
        """Return the derivatives (2 N + 10, 10) of the residuals by the logarithms."""
        knees, linear = np.exp(numbers[_KNEE]), np.exp(numbers[_LINEAR])
        found = np.empty((self.forces.size, numbers.size))
        found[:, _LINEAR] = self._design(knees) * linear
        by_knee = (_knee_weights(k) @ own for k, own in zip(knees, linear.reshape(2, -1), strict=True))
        found[:, _KNEE] = self.weights @ block_diag(*(column[:, None] for column in by_knee))
        return np.vstack([found, _PULL * np.eye(numbers.size)])

    def _design(self, knees: Array) -> Array:
        """Return the matrix M (2 N, 8) at knee speeds (2,) [m/s]."""
        return np.asarray(self.weights @ block_diag(*(slope_weights(_KNOTS, knee) for knee in knees)))


def _knee_weights(knee: float) -> Array:
    """Return the derivatives (K, 4) of `slope_weights` at the knots by the logarithm of the knee speed."""
    square = (_KNOTS / knee) ** 2
    at_rest, closed = np.exp(-square / BLEED_SHARE**2), 1.0 / (1.0 + square)
    by_rest, by_closed = 2.0 * square / BLEED_SHARE**2 * at_rest, 2.0 * square * closed**2
    opened = -by_rest * (1.0 - closed) - (1.0 - at_rest) * by_closed
    return np.stack([by_rest, (1.0 - at_rest) * by_closed - by_rest * closed, opened, opened * _KNOTS], axis=1)


def _force_weights(speeds: Array) -> Array:
    """Return the weights (2 N, 2 K) of the slopes at the knots in the forces at speeds (2, N) [m/s].

    The slope is linear between the knots; at rest both sides have the mean of their two.
    """
    slope = np.eye(_KNOTS.size)
    force = cumulative_trapezoid(slope, _KNOTS, axis=0, initial=0)
    growth = np.diff(slope, axis=0) / np.diff(_KNOTS)[:, None]
    before = np.clip(np.searchsorted(_KNOTS, speeds, side="right") - 1, 0, _KNOTS.size - 2)
    into = (speeds - _KNOTS[before])[..., None]
    sides = force[before] + into * (slope[before] + 0.5 * growth[before] * into)
    found = block_diag(*sides)
    at_rest = [0, _KNOTS.size]
    found[:, at_rest] = 0.5 * found[:, at_rest].sum(axis=1, keepdims=True)
    return np.asarray(found)


def difference(one: Shape, other: Callable[[float], float], reach: float = REACH) -> tuple[float, float]:
    """Return the RMS difference of the forces [N] of a shape and a curve at equal steps of the root of the speed.

    The second value is its share of the shape's RMS force [1].
    """
    speed = reach * _SPEEDS
    velocity = np.concatenate([-speed[::-1], speed]).tolist()
    curve = one.curve(reach)
    own = np.array([curve.force(v) for v in velocity])
    error = own - np.array([other(v) for v in velocity])
    rms = float(np.sqrt(np.mean(error**2)))
    return rms, rms / float(np.sqrt(np.mean(own**2)))
