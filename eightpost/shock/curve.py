"""The static curve F_s = f(v), the force of a shock without lag (Eq 3.23, "Polylinear" of 3.1.5).

Standard library only: the FMU contains a copy of this file. The computations are module-level functions of floats,
tuples and `CurveNumbers`, so that a compiler such as numba can compile them unchanged.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

#: Orders of the dissertation's fit (3.3.1).
INNER_ORDER = 15
OUTER_ORDER = 3
#: Number of knots of a curve through knots; the middle one is at zero velocity and zero force.
KNOTS = 25
_NO_KNOTS = (0.0,) * KNOTS


class CurveNumbers(NamedTuple):
    """The numbers of a `StaticCurve`, under the same names."""

    inner: tuple[float, ...]
    compression: tuple[float, ...]
    rebound: tuple[float, ...]
    transition_speed: float
    transition_width: float
    compression_speed: float
    rebound_speed: float
    compression_slope: float
    rebound_slope: float
    knot_velocity: tuple[float, ...] = _NO_KNOTS
    knot_force: tuple[float, ...] = _NO_KNOTS
    knot_slope: tuple[float, ...] = _NO_KNOTS


def _polynomial(coefficients: tuple[float, ...], s: float) -> float:
    """Return c_0 + c_1 s + c_2 s^2 + ... as four independent sums in powers of s^4, which a processor can overlap."""
    square = s * s
    fourth = square * square
    low = _every_fourth(coefficients, 0, fourth) + s * _every_fourth(coefficients, 1, fourth)
    high = _every_fourth(coefficients, 2, fourth) + s * _every_fourth(coefficients, 3, fourth)
    return low + square * high


def _every_fourth(coefficients: tuple[float, ...], first: int, s: float) -> float:
    """Return c_j + c_(j+4) s + c_(j+8) s^2 + ..., j being `first`, by Horner's rule."""
    value = 0.0
    last = len(coefficients) - 1
    for k in range(last - (last - first) % 4, first - 1, -4):
        value = value * s + coefficients[k]
    return value


def curve_force(curve: CurveNumbers | StaticCurve, velocity: float) -> float:
    """Return F_s [N] at a damper velocity [m/s], positive in compression (Eq 3.23)."""
    high, low = curve.compression_speed, -curve.rebound_speed
    if velocity > high:
        return _fitted_force(curve, high) + curve.compression_slope * (velocity - high)
    if velocity < low:
        return _fitted_force(curve, low) + curve.rebound_slope * (velocity - low)
    return _fitted_force(curve, velocity)


def _fitted_force(curve: CurveNumbers | StaticCurve, velocity: float) -> float:
    """Return the force [N] at a damper velocity [m/s] inside the fitted range: of the knots, or of the polynomials."""
    if curve.knot_velocity[KNOTS - 1] > 0.0:
        return _force_through_knots(curve, velocity)
    share = outer_share(curve, abs(velocity))
    inner = outer = 0.0
    if share < 1.0:
        s = velocity / curve.transition_speed
        inner = s * _polynomial(curve.inner, s)
    if share > 0.0:
        coefficients = curve.compression if velocity > 0.0 else curve.rebound
        outer = _polynomial(coefficients, (abs(velocity) - curve.transition_speed) / curve.transition_speed)
    return (1.0 - share) * inner + share * outer


def _force_through_knots(curve: CurveNumbers | StaticCurve, velocity: float) -> float:
    """Return the cubic Hermite spline of the knots [N] at a damper velocity [m/s]."""
    k = cell_of(curve.knot_velocity, velocity)
    width = curve.knot_velocity[k + 1] - curve.knot_velocity[k]
    rise = curve.knot_force[k + 1] - curve.knot_force[k]
    start, end = width * curve.knot_slope[k], width * curve.knot_slope[k + 1]
    x = (velocity - curve.knot_velocity[k]) / width
    return curve.knot_force[k] + x * (start + x * ((3.0 * rise - 2.0 * start - end) + x * (start + end - 2.0 * rise)))


def cell_of(knots: tuple[float, ...], velocity: float) -> int:
    """Return the index of the last knot that is not above a velocity, from 0 to `KNOTS` - 2, by bisection."""
    low, high = 0, KNOTS - 1
    while high - low > 1:
        middle = (low + high) // 2
        if velocity < knots[middle]:
            high = middle
        else:
            low = middle
    return low


def outer_share(curve: CurveNumbers | StaticCurve, speed: float) -> float:
    """Return the outer cubic's share [1] at a speed [m/s]."""
    share = (speed - curve.transition_speed) / curve.transition_width + 0.5
    return min(max(share, 0.0), 1.0)


@dataclass(frozen=True, slots=True, repr=False)
class StaticCurve:
    """The dissertation's polynomials or a spline through knots; straight lines outside the fitted range.

    Polynomials: one of high order at low speed, a cubic on each side beyond (3.3.1).

        inner(v)       = sum_k inner[k-1] (v / v_t)^k              k = 1 .. 15, so that f(0) = 0
        compression(v) = sum_k compression[k] ((v - v_t) / v_t)^k   k = 0 .. 3
        rebound(v)     = sum_k rebound[k] ((-v - v_t) / v_t)^k      k = 0 .. 3

    The pieces are blended linearly over `transition_width` about v_t = `transition_speed`. Beyond the fitted speeds
    the curve continues with the given slopes, because a polynomial is not valid outside its data (Fig 3.5a).

    Knots: a cubic Hermite spline through points with given slopes replaces the polynomials. If each segment's force
    rises by the mean of the slopes at its ends, the spline is quadratic and rises wherever no slope is negative.

    Raises:
        ValueError: A value is not finite or outside its range; the message names it.
    """

    inner: tuple[float, ...]  #: 15 coefficients [N].
    compression: tuple[float, ...]  #: 4 coefficients [N].
    rebound: tuple[float, ...]  #: 4 coefficients [N]; the force is negative in rebound.
    transition_speed: float  #: v_t [m/s]; 15 in/s in 3.3.1.
    transition_width: float  #: Width of the transition [m/s], less than twice `transition_speed`; 0.5 in/s in 3.3.1.
    compression_speed: float  #: Highest fitted speed in compression [m/s], positive.
    rebound_speed: float  #: Highest fitted speed in rebound [m/s], positive.
    compression_slope: float  #: Slope beyond `compression_speed` [N.s/m], not negative.
    rebound_slope: float  #: Slope beyond `rebound_speed` [N.s/m], not negative.
    #: Velocities of 25 knots [m/s], ascending from -`rebound_speed` to `compression_speed`, the middle one 0. All
    #: zeros: the curve is that of the polynomials.
    knot_velocity: tuple[float, ...] = _NO_KNOTS
    knot_force: tuple[float, ...] = _NO_KNOTS  #: Force at the knots [N], 0 at the middle one.
    knot_slope: tuple[float, ...] = _NO_KNOTS  #: Slope at the knots [N.s/m], not negative.

    def __repr__(self) -> str:
        """Return form, ends and forces there; the coefficients are too many to read."""
        ends = f"{self.force(-self.rebound_speed):.5g} to {self.force(self.compression_speed):.5g} N"
        form = f"{KNOTS} knots" if self.has_knots else "polynomials"
        return f"<StaticCurve: {form}, {ends} from {-self.rebound_speed:.4g} to {self.compression_speed:.4g} m/s>"

    def __post_init__(self) -> None:
        self._check_coefficients("inner", INNER_ORDER)
        self._check_coefficients("compression", OUTER_ORDER + 1)
        self._check_coefficients("rebound", OUTER_ORDER + 1)
        for name in ("transition_speed", "transition_width", "compression_speed", "rebound_speed"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"curve: {name} must be positive, not {getattr(self, name)!r}")
        if self.transition_width >= 2.0 * self.transition_speed:
            raise ValueError(
                f"curve: transition_width {self.transition_width!r} must be less than twice transition_speed "
                f"{self.transition_speed!r}, because the curve must pass through zero at zero velocity"
            )
        for name in ("compression_slope", "rebound_slope"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"curve: {name} must not be negative, not {getattr(self, name)!r}")
        self._check_knots()

    def _check_knots(self) -> None:
        for name in ("knot_velocity", "knot_force", "knot_slope"):
            self._check_coefficients(name, KNOTS)
        knots, middle = self.knot_velocity, KNOTS // 2
        if not any(knots):
            if any(self.knot_force) or any(self.knot_slope):
                raise ValueError("curve: knot_force and knot_slope are given, but knot_velocity is all zeros")
            return
        if not all(low < high for low, high in itertools.pairwise(knots)):
            raise ValueError(f"curve: knot_velocity must be ascending, not {knots!r}")
        if knots[middle] != 0.0 or self.knot_force[middle] != 0.0:
            raise ValueError(
                f"curve: the middle knot must be at zero velocity and zero force, not at {knots[middle]!r} m/s and "
                f"{self.knot_force[middle]!r} N"
            )
        if knots[0] != -self.rebound_speed or knots[-1] != self.compression_speed:
            raise ValueError(
                f"curve: the knots must end at -rebound_speed ({-self.rebound_speed!r} m/s) and compression_speed "
                f"({self.compression_speed!r} m/s), not at {knots[0]!r} and {knots[-1]!r} m/s"
            )
        if min(self.knot_slope) < 0.0:
            raise ValueError(f"curve: knot_slope must not be negative, not {self.knot_slope!r}")

    def _check_coefficients(self, name: str, count: int) -> None:
        values = getattr(self, name)
        if len(values) != count or not all(isfinite(value) for value in values):
            raise ValueError(f"curve: {name} must have {count} finite values, not {values!r}")

    @property
    def has_knots(self) -> bool:
        """Whether the curve is a spline through knots."""
        return self.knot_velocity[-1] > 0.0

    def force(self, velocity: float) -> float:
        """Return F_s [N] at a damper velocity [m/s], positive in compression (Eq 3.23)."""
        return curve_force(self, velocity)

    @staticmethod
    def through_knots(
        velocity: tuple[float, ...],
        force: tuple[float, ...],
        slope: tuple[float, ...],
        *,
        compression_slope: float | None = None,
        rebound_slope: float | None = None,
    ) -> StaticCurve:
        """Return a curve through 25 knots; beyond them it continues with the end slopes unless others are given."""
        fast = max(-velocity[0], velocity[-1])
        return StaticCurve(
            inner=(0.0,) * INNER_ORDER,
            compression=(0.0,) * (OUTER_ORDER + 1),
            rebound=(0.0,) * (OUTER_ORDER + 1),
            transition_speed=fast,
            transition_width=fast,
            compression_speed=velocity[-1],
            rebound_speed=-velocity[0],
            compression_slope=slope[-1] if compression_slope is None else compression_slope,
            rebound_slope=slope[0] if rebound_slope is None else rebound_slope,
            knot_velocity=velocity,
            knot_force=force,
            knot_slope=slope,
        )

    def is_beyond_fit(self, velocity: float) -> bool:
        """Return whether a damper velocity [m/s] is outside the fitted range."""
        return velocity > self.compression_speed or velocity < -self.rebound_speed

    def numbers(self) -> CurveNumbers:
        """Return the curve as plain numbers."""
        return CurveNumbers(*(getattr(self, name) for name in CurveNumbers._fields))
