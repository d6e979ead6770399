"""A shock as a few shape numbers: a curve that nobody has built yet, for the search of a curve to aim at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import isfinite

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares, nnls

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.law import Port, ShockLaw
from eightpost.shock.lpf1 import Lpf1
from eightpost.shock.lpnl2 import Lpnl2

# ---- Shapes (chapter 8) ---------------------------------------------------------------------------------------------
# Each side of the static curve has five numbers; its slope is a mean of them with positive weights, so the force always
# rises with velocity and the shock is passive:
#
#     c(v) = b c_bleed + (1 - b) [l c_low + (1 - l) (c_high + a v)]
#     b = exp(-(4 v / v_k)^2),   l = 1 / (1 + (v / v_k)^2),   v = |velocity|
#
# c_bleed is the slope at rest, where an open bleed lets the oil pass; c_low applies from a quarter of the knee speed
# v_k to the knee; beyond it the valve is open, with the slope c_high and its growth a, which ports cause at high speed.

SIDES = ("compression", "rebound")  #: Sides of a curve, in the order of the numbers of a shape.
REACH = 1.3  #: Highest speed of the knots of a shape's curve [m/s]: that of the shipped bank's dynamometer tests.
BLEED_SHARE = 0.25  #: Speed up to which the bleed acts, as a share of the knee speed.
#: Speeds of the knots of one side, as shares of the highest [1]: closer at low speed, where the slope changes most.
SHARES = np.linspace(0.0, 1.0, KNOTS // 2 + 1) ** 2.2


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a curve, compression or rebound; all numbers are positive, `rise` may be 0.

    Raises:
        ParameterError: A number is not finite or not positive; the message names it.
    """

    bleed: float  #: Slope at rest [N.s/m].
    low: float  #: Slope between bleed and knee [N.s/m].
    knee: float  #: Speed of the knee [m/s].
    high: float  #: Slope beyond the knee, extrapolated to zero speed [N.s/m].
    rise: float  #: Growth of that slope with speed [N.s2/m2].

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (isfinite(value) and (value > 0.0 or (one.name == "rise" and value == 0.0))):
                raise ParameterError(f"shape: {one.name} must be positive, not {value!r}")

    def slope(self, speed: Array) -> Array:
        """Return the slope (N,) [N.s/m] at speeds (N,) [m/s]."""
        return np.asarray(_slope_weights(speed, self.knee) @ np.array([self.bleed, self.low, self.high, self.rise]))


#: SI unit of each number of a side.
UNITS = {"bleed": "N.s/m", "low": "N.s/m", "knee": "m/s", "high": "N.s/m", "rise": "N.s2/m2"}


@dataclass(frozen=True, slots=True)
class Shape:
    """A shock as shape numbers: both sides of the curve, lag and gas.

    Raises:
        ParameterError: A number is out of range; the message names it.
    """

    compression: Side  #: Compression side.
    rebound: Side  #: Rebound side.
    lag: float = 1e-3  #: Time constant of the lag [s] (LPNL2).
    lag_force: float = 3000.0  #: Force from which there is no lag [N] (LPNL2).
    gas: float = 0.0  #: Gas force at zero displacement [N]; 0 if the vehicle's static state contains it.

    def __post_init__(self) -> None:
        for name in ("lag", "lag_force"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ParameterError(f"shape: {name} must be positive, not {getattr(self, name)!r}")
        if self.lag_force <= LAG_FULL_FORCE:
            raise ParameterError(f"shape: lag_force must be above {LAG_FULL_FORCE:.4g} N, not {self.lag_force!r} N")
        if not isfinite(self.gas):
            raise ParameterError(f"shape: gas must be finite, not {self.gas!r}")

    def curve(self, reach: float = REACH) -> StaticCurve:
        """Return the curve through knots up to a speed [m/s], between which the slope is linear."""
        speed = reach * SHARES
        slopes = {name: getattr(self, name).slope(speed) for name in SIDES}
        at_rest = 0.5 * (self.compression.bleed + self.rebound.bleed)  # one slope at rest, so that there is no corner
        for slope in slopes.values():
            slope[0] = at_rest
        forces = {name: cumulative_trapezoid(slope, speed, initial=0) for name, slope in slopes.items()}
        return StaticCurve.through_knots(
            joined(-speed, speed),
            joined(-forces["rebound"], forces["compression"]),
            joined(slopes["rebound"], slopes["compression"]),
        )

    def law(self, reach: float = REACH) -> Lpnl2:
        """Return the shape as a law with lag and gas force."""
        return Lpnl2(self.curve(reach), self.lag, LAG_FULL_FORCE, self.lag_force, port=Port(gas_preload=self.gas))

    def parameters(self) -> dict[str, float]:
        """Return the parameters by which an FMU of a shape becomes this one; the knots' velocities are the same."""
        found = curve_parameters(self.curve(), ("knot_force", "knot_slope"))
        return found | {"time_constant": self.lag, "lag_zero_force": self.lag_force, "gas_preload": self.gas}

    def numbers(self) -> dict[str, float]:
        """Return the numbers by name, such as `rebound.low`."""
        found = {f"{side}.{name}": getattr(getattr(self, side), name) for side in SIDES for name in UNITS}
        return found | {"lag": self.lag, "lag_force": self.lag_force, "gas": self.gas}

    def with_numbers(self, values: Mapping[str, float]) -> Shape:
        """Return the shape with other values of some numbers.

        Raises:
            ParameterError: There is no such number, or a value is out of range.
        """
        if unknown := sorted(set(values) - set(self.numbers())):
            raise ParameterError(f"shape: there is no number {unknown[0]!r}; they are {', '.join(self.numbers())}")
        numbers = self.numbers() | dict(values)
        compression, rebound = (Side(*(numbers[f"{side}.{name}"] for name in UNITS)) for side in SIDES)
        return Shape(compression, rebound, numbers["lag"], numbers["lag_force"], numbers["gas"])


#: Force up to which the lag is complete [N]: the lower bound of 3.3.3, at which the fits of the shipped bank end.
LAG_FULL_FORCE = 44.482216152605


def curve_parameters(
    curve: StaticCurve, arrays: Sequence[str] = ("knot_velocity", "knot_force", "knot_slope")
) -> dict[str, float]:
    """Return a curve through knots as parameters of a shock FMU by name (docs/reference/ports.md)."""
    found = {f"curve.{name}": getattr(curve, name) for name in ("compression_slope", "rebound_slope")}
    if "knot_velocity" in arrays:
        found |= {f"curve.{name}": getattr(curve, name) for name in ("compression_speed", "rebound_speed")}
    for name in arrays:
        found |= {f"curve.{name}[{k}]": value for k, value in enumerate(getattr(curve, name), start=1)}
    return found


def unit_of(number: str) -> str:
    """Return the SI unit of a shape number by its name.

    >>> unit_of("rebound.knee"), unit_of("lag")
    ('m/s', 's')
    """
    return {"lag": "s", "lag_force": "N", "gas": "N"}.get(number) or UNITS[number.partition(".")[2]]


def _slope_weights(speed: Array, knee: float) -> Array:
    """Return the weights (N, 4) of bleed, low, high and rise in the slope at speeds (N,) [m/s]."""
    at_rest = np.exp(-((speed / (BLEED_SHARE * knee)) ** 2))
    closed = 1.0 / (1.0 + (speed / knee) ** 2)
    opened = (1.0 - at_rest) * (1.0 - closed)
    return np.stack([at_rest, (1.0 - at_rest) * closed, opened, opened * speed], axis=1)


def joined(rebound: Array, compression: Array) -> tuple[float, ...]:
    """Return both sides (K,) as one ascending sequence; both begin with the same value, that at rest."""
    return (*rebound[:0:-1].tolist(), *compression.tolist())


#: Numbers of the curve: all but lag and gas.
CURVE_NUMBERS = tuple(f"{side}.{name}" for side in SIDES for name in UNITS)
NUMBERS = (*CURVE_NUMBERS, "lag", "lag_force", "gas")  #: Names of all numbers of a shape.


def range_of(shapes: Sequence[Shape], number: str) -> tuple[float, float]:
    """Return the lowest and the highest value of a number among shapes.

    Raises:
        ParameterError: There is no such number, or all shapes have the same value.
    """
    if number not in shapes[0].numbers():
        raise ParameterError(f"shape: there is no number {number!r}; they are {', '.join(shapes[0].numbers())}")
    values = [shape.numbers()[number] for shape in shapes]
    if not min(values) < max(values):
        raise ParameterError(f"shape: {number} is {values[0]:g} {unit_of(number)} in all shocks; state its limits")
    return min(values), max(values)


# ---- The shape that comes closest to a curve: least squares of the force, both sides at once ------------------------
# Both sides share the slope at rest, so neither can be fitted alone. The force is linear in the slopes at the knots,
# and these are linear in all numbers but the knee speeds v_k (2,):
#
#     F = M(v_k) p,   p = (bleed, low, high, rise) of both sides (8,)
#
# Linear fits at pairs of knee speeds give the starts, from which all ten numbers are searched with exact derivatives.

_COMPARED = 80  #: Number of speeds of a side at which a shape is compared with a curve.
#: Those speeds, as shares of the highest [1]: at equal steps of their root.
_SPEEDS = np.linspace(0.0, 1.0, _COMPARED + 1)[1:] ** 2
#: Bounds of each number of a side [SI].
BOUNDS = {"bleed": (200.0, 3e4), "low": (200.0, 3e4), "knee": (0.02, 0.4), "high": (50.0, 2e4), "rise": (1.0, 1e4)}
#: The same as logarithms (10, 2), and their middles (10,).
_BOUNDS = np.log([BOUNDS[name] for name in UNITS] * 2)
_MIDDLE = _BOUNDS.mean(axis=1)
#: Places of the knee speeds among the ten numbers, and of those that the slope is linear in.
_KNEE = np.flatnonzero([name == "knee" for name in UNITS] * 2)
_LINEAR = np.flatnonzero([name != "knee" for name in UNITS] * 2)
_KNEES = np.geomspace(0.025, 0.39, 8)  #: Knee speeds of the linear fits of each side [m/s].
#: Weight of the distance from the middle of the bounds, as a share of the RMS force: a number that the curve does not
#: determine stays in the middle.
_PULL = 1e-3
_KNOTS = REACH * SHARES  #: Speeds of the knots of a side (K,) [m/s].


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


def fit_force(force: Callable[[float], float], compression_speed: float, rebound_speed: float) -> ShapeFit:
    """Fit a shape to a force [N] over velocity [m/s], up to a speed of each side [m/s].

    The squares of the force are least at equal steps of the root of the speed.
    """
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

        def residuals(numbers: Array) -> Array:
            return np.concatenate([self.errors(numbers), _PULL * (numbers - _MIDDLE)])

        starts = self._starts()
        ends = [least_squares(residuals, start, self._jacobian, (low, high), x_scale="jac") for start in starts]
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
        return np.asarray(self.weights @ block_diag(*(_slope_weights(_KNOTS, knee) for knee in knees)))


def _knee_weights(knee: float) -> Array:
    """Return the derivatives (K, 4) of `_slope_weights` at the knots by the logarithm of the knee speed."""
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


# ---- A curve with a steeper or flatter side: what a click would do to a shock without a fitted adjuster -------------

LOW_SPEED = 0.1  #: Speed at which a change of the low-speed slope has fallen to a quarter [m/s].


def with_slope(curve: StaticCurve, side: str, share: float, speeds: str) -> tuple[StaticCurve, StaticCurve]:
    """Return a curve through knots, and the same curve with a steeper side; both have the same knots.

    Low-speed slopes change by the share w = 1 / (1 + (v / 0.1 m/s)^2)^2 of the change, high-speed ones by 1 - w, and
    the slopes at all speeds by the whole change.

    Args:
        curve: Curve, of polynomials or through knots.
        side: `compression` or `rebound`.
        share: Relative change of the slope [1], such as 0.1.
        speeds: `low`, `high` or `all`.

    Raises:
        ParameterError: The side or the speeds do not exist, or no slope would be left.
    """
    if side not in SIDES or speeds not in ("low", "high", "all"):
        raise ParameterError(f"a change is of compression or rebound, at low, high or all speeds, not {side}, {speeds}")
    if not share > -1.0:
        raise ParameterError(f"a slope cannot change by {share:g}: nothing would be left; use a change above -1")
    velocity = joined(-curve.rebound_speed * SHARES, curve.compression_speed * SHARES)
    places, sign = np.array(velocity), 1.0 if side == "compression" else -1.0
    near = 1.0 / (1.0 + (places / LOW_SPEED) ** 2) ** 2
    factors = 1.0 + share * {"low": near, "high": 1.0 - near, "all": np.ones(KNOTS)}[speeds]
    own = sign * (places[1:] + places[:-1]) > 0.0
    cells = np.where(own, 0.5 * (factors[1:] + factors[:-1]), 1.0)
    knots = np.where(sign * places >= 0.0, factors, 1.0)
    return _through(curve, velocity, np.ones(KNOTS - 1), np.ones(KNOTS)), _through(curve, velocity, cells, knots)


def _through(curve: StaticCurve, velocity: tuple[float, ...], cells: Array, knots: Array) -> StaticCurve:
    """Return a rising curve through knots on a curve, its slopes times factors of the cells (K - 1,) and knots (K,)."""
    widths = np.diff(velocity)
    secants = np.maximum(np.diff([curve.force(v) for v in velocity]) / widths, 0.0)
    inner = (secants[:-1] * widths[1:] + secants[1:] * widths[:-1]) / (widths[1:] + widths[:-1])
    slope = knots * np.concatenate([[curve.rebound_slope], inner, [curve.compression_slope]])
    total = np.concatenate([[0.0], np.cumsum(secants * widths * cells)])
    return StaticCurve.through_knots(
        velocity,
        tuple((total - total[KNOTS // 2]).tolist()),
        tuple(np.minimum(slope, 3.0 * _least(secants * cells)).tolist()),
        compression_slope=float(slope[-1]),
        rebound_slope=float(slope[0]),
    )


def _least(secants: Array) -> Array:
    """Return the smaller slope (K,) of both cells at each knot: three times that keeps the spline rising."""
    before, after = np.concatenate([secants[:1], secants]), np.concatenate([secants, secants[-1:]])
    return np.asarray(np.minimum(before, after), dtype=np.float64)
