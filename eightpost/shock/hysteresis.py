"""Hysteresis: a curve of the velocity, a curve of a lagged velocity and a creeping stop in parallel.

Standard library only: the FMU contains a copy of this file. The static curve F_s is divided into two rising curves,
f0 of the velocity v and f1 of the lagged velocity u; the stop of stiffness ks yields at the deflection e_y:

    F_v = f0(v) + f1(u) + ks e,   F_s = f0 + f1
    du/dt = (v - u) / tau(u)
    de/dt = v - sgn(e) max(|e| - e_y, 0) / t_s

The law is passive, because no slope of f0 and f1 is negative: f1(u) v = f1(u) u + d/dt of the integral of f1 tau du,
and ks e v = ks |e| max(|e| - e_y, 0) / t_s + d/dt(ks e^2 / 2).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import copysign, exp, isfinite, log

from .curve import KNOTS, CurveNumbers, StaticCurve, cell_of
from .law import FitParameter, Piece, ShockLaw, Valve, advance

STATES = ("lagged_velocity", "stop_travel")  #: Names of the states: u [m/s] and e [m].
#: Numbers of values of the parameters that are tuples; they are first in `own`.
SIZES = {"lagged_slope": KNOTS, "time_constant": 3}
FIT_FORM = "lagged velocity"  #: It has a recipe of its own.

FIT_PARAMETERS: tuple[FitParameter, ...] = ()
UNITS = {"lagged_slope": "N.s/m", "time_constant": "s", "stop_stiffness": "N/m", "stop_yield": "m", "stop_time": "s"}
#: Places in `own`: the slopes c_k begin at 0, then follow tau at its three nodes, ks, e_y and t_s.
_TAU = KNOTS
_STIFFNESS, _YIELD, _TIME = KNOTS + 3, KNOTS + 4, KNOTS + 5
#: Speed [m/s] up to which a shock is at rest at the start: in the coupled start of a car, rounding moves its shocks.
REST = 1e-9
_MOST_TURNS = 8  #: Largest number of times that the stop yields or stops to yield in a piece.
_ROUNDING = 1e-9  #: Largest deviation of a cell's rise from that of a quadratic one, relative to the largest force.


def start_core(velocity: float, static_force: float, own: tuple[float, ...], valve: Valve) -> tuple[float, float]:
    """Return the states of steady motion at a damper velocity [m/s]: u = v, and a yielding stop unless at rest."""
    travel = 0.0 if abs(velocity) <= REST else copysign(own[_YIELD] + abs(velocity) * own[_TIME], velocity)
    return velocity, travel


def advance_core(
    states: tuple[float, float], piece: Piece, own: tuple[float, ...], valve: Valve
) -> tuple[float, float]:
    """Return the states after a piece.

    The lag is solved exactly for a constant tau; two passes take tau at the middle of the change of u. The stop is
    solved exactly while it yields or while it does not.
    """
    u, after = states[0], states[0]
    for _ in range(2):
        tau = _time_constant_at(0.5 * (u + after), own, valve.curve)
        after = advance(u, piece.velocity_start, piece.velocity_end, tau, piece.step)
    return after, _travel(states[1], piece, own[_YIELD], own[_TIME])


def force_core(
    states: tuple[float, float], velocity: float, static_force: float, own: tuple[float, ...], valve: Valve
) -> float:
    """Return F_v [N] at a damper velocity [m/s] and its F_s [N]; the port's scales apply to f0 and f1."""
    scale = valve.compression_scale if velocity > 0.0 else valve.rebound_scale
    lagged_scale = valve.compression_scale if states[0] > 0.0 else valve.rebound_scale
    fixed = static_force - scale * _lagged_curve(velocity, own, valve.curve)
    return fixed + lagged_scale * _lagged_curve(states[0], own, valve.curve) + own[_STIFFNESS] * states[1]


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """Return alpha = 1: the lagged force is the whole force of the valves."""
    return 1.0


def _lagged_curve(velocity: float, own: tuple[float, ...], curve: CurveNumbers | StaticCurve) -> float:
    """Return f1 [N] at a velocity [m/s]: the integral of the slopes c, which are linear between knots."""
    knots = curve.knot_velocity
    inside = min(max(velocity, knots[0]), knots[KNOTS - 1])
    k = cell_of(knots, inside)
    bend = (own[k + 1] - own[k]) / (knots[k + 1] - knots[k])
    force = 0.0
    if inside >= 0.0:
        for j in range(KNOTS // 2, k):
            force += 0.5 * (own[j] + own[j + 1]) * (knots[j + 1] - knots[j])
        x = inside - knots[k]
        force += x * (own[k] + 0.5 * bend * x)
    else:
        for j in range(KNOTS // 2 - 1, k, -1):
            force -= 0.5 * (own[j] + own[j + 1]) * (knots[j + 1] - knots[j])
        x = inside - knots[k + 1]
        force += x * (own[k + 1] + 0.5 * bend * x)
    return force + (own[KNOTS - 1] if velocity > 0.0 else own[0]) * (velocity - inside)


def _time_constant_at(velocity: float, own: tuple[float, ...], curve: CurveNumbers | StaticCurve) -> float:
    """Return tau [s] at a lagged velocity [m/s]: its logarithm is linear up to half of the fitted speeds."""
    speed = curve.compression_speed if velocity >= 0.0 else curve.rebound_speed
    end = own[_TAU + 2] if velocity >= 0.0 else own[_TAU]
    share = min(abs(velocity) / (0.5 * speed), 1.0)
    return own[_TAU + 1] * exp(share * log(end / own[_TAU + 1]))


def _travel(travel: float, piece: Piece, limit: float, time: float) -> float:
    """Return e [m] after a piece; `limit` is e_y and `time` t_s.

    Where the stop begins to yield, and where it stops to, the velocity of e is continuous. So it is enough to find
    these times by linear interpolation.
    """
    start, end, step = piece.velocity_start, piece.velocity_end, piece.step
    yields = abs(travel) > limit
    for _ in range(_MOST_TURNS):
        edge = copysign(limit, travel)
        if yields:
            over = travel - edge
            after = advance(over, start * time, end * time, time, step)
            if after * edge >= 0.0:
                return edge + after
            share = over / (over - after)
        else:
            after = travel + 0.5 * (start + end) * step
            if abs(after) <= limit:
                return after
            edge = copysign(limit, after)
            share = (edge - travel) / (after - travel)
        start += (end - start) * share
        step *= 1.0 - share
        travel, yields = edge, not yields
        if step <= 0.0:
            return travel
    return travel


@dataclass(frozen=True, slots=True)
class Hysteresis(ShockLaw):
    """F_v = f0(v) + f1(u) + ks e, with a lagged velocity u and the deflection e of a creeping stop.

    Raises:
        ValueError: A parameter is out of range, or the curve has no knots or a cell that is not quadratic, so that f0
            might fall somewhere.
    """

    #: Slopes c_k of f1 [N.s/m] at the 25 knots of the curve, from 0 to the curve's slope there; linear in between.
    lagged_slope: tuple[float, ...] = field(repr=False)
    time_constant: tuple[float, float, float]  #: tau [s] at u = -rebound_speed / 2, 0 and compression_speed / 2.
    stop_stiffness: float = 0.0  #: ks [N/m].
    stop_yield: float = 1e-3  #: e_y [m].
    stop_time: float = 1e-2  #: t_s [s].

    def __post_init__(self) -> None:
        for name, size in SIZES.items():
            values = getattr(self, name)
            if not isinstance(values, tuple) or len(values) != size or not all(isfinite(value) for value in values):
                raise ValueError(f"{name} must have {size} finite values, not {values!r}")
        if min(self.time_constant) <= 0.0:
            raise ValueError(f"time_constant must be positive, not {self.time_constant!r}")
        if not (isfinite(self.stop_stiffness) and self.stop_stiffness >= 0.0):
            raise ValueError(f"stop_stiffness must not be negative, not {self.stop_stiffness!r}")
        for name in ("stop_yield", "stop_time"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")
        self._check_curve()

    def _check_curve(self) -> None:
        curve, slopes = self.curve, self.curve.knot_slope
        if not curve.has_knots:
            raise ValueError("curve: a Hysteresis law needs a curve through knots; fit one, or use another law")
        largest = max(1.0, *(abs(force) for force in curve.knot_force))
        for k in range(KNOTS - 1):
            width = curve.knot_velocity[k + 1] - curve.knot_velocity[k]
            rise = curve.knot_force[k + 1] - curve.knot_force[k]
            if abs(rise - 0.5 * (slopes[k] + slopes[k + 1]) * width) > _ROUNDING * largest:
                raise ValueError(
                    f"curve: from {curve.knot_velocity[k]!r} to {curve.knot_velocity[k + 1]!r} m/s the force rises by "
                    f"{rise!r} N, which is not the mean of the slopes at the ends times the width; a Hysteresis law "
                    "needs quadratic cells, so that it is passive"
                )
        ends = (curve.rebound_slope, *slopes, curve.compression_slope)
        lagged = (self.lagged_slope[0], *self.lagged_slope, self.lagged_slope[-1])
        for most, slope in zip(ends, lagged, strict=True):
            if not 0.0 <= slope <= most:
                raise ValueError(
                    f"lagged_slope must be from 0 to the slope of the curve, not {slope!r} where that is {most!r} N.s/m"
                )

    @property
    def own(self) -> tuple[float, ...]:
        """The law's own parameters as `advance_core` takes them."""
        return (*self.lagged_slope, *self.time_constant, self.stop_stiffness, self.stop_yield, self.stop_time)

    def start(self, velocity: float) -> tuple[float, float]:
        """Return u [m/s] and e [m] of steady motion at a port velocity [m/s]."""
        return start_core(self.port.motion_ratio * velocity, 0.0, self.own, self.valve)

    def lag_weight(self, static_force: float) -> float:
        """Return alpha = 1: the lagged force is the whole force of the valves."""
        return weight_core(static_force, ())

    def advance_piece(self, state: tuple[float, float], piece: Piece) -> tuple[float, float]:
        """Return u [m/s] and e [m] after a piece."""
        return advance_core(state, piece, self.own, self.valve)

    def valve_force(self, state: tuple[float, float], velocity: float) -> float:
        """Return F_v [N] at a port velocity [m/s]."""
        damper_velocity = self.port.motion_ratio * velocity
        return force_core(state, damper_velocity, self.static_force(velocity), self.own, self.valve)
