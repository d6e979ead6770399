"""Maxwell: the static curve and a stiffness in series. Standard library only: the FMU contains a copy of this file.

The oil and the hoses compress before the valves open: the piston moves with v, the oil through the valves with w, and
the difference strains the spring,

    dF/dt = k (v - w),   F = f(w),   so that   (f'(w) / k) dw/dt = v - w

with f the static force over velocity. Where the curve is straight the law is LPF1 with tau = f'/k; where it is flat,
w = v at once; for infinite k it is Polylinear.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, inf, isfinite

from .curve import KNOTS
from .lag import advance
from .law import STRAIGHT, FitParameter, Piece, ShockLaw, Valve, valve_force

FIT_FORM = "series spring"

#: Cost of a ramped step of the native FMU relative to Polylinear (benchmarks/native.py --cost).
STEP_COST = 19.0

#: From as soft as rubber to a hundred times as stiff as an oil column.
FIT_PARAMETERS = (FitParameter("series_stiffness", "N/m", low=1e5, start=3e6, high=1e9, scale="logarithmic"),)

#: Shortest chord, and first step of the search for a velocity [m/s].
_SHORTEST = 1e-9
_FIRST = 1e-3
#: Maximum number of parts of a piece and of steps of the search for a velocity; far more than any curve needs.
_MOST_PARTS = 1000
_MOST_TRIES = 100
#: Number of time constants after which the start of a lag has no effect: exp(-1000) = 0.
_SETTLED = 1000.0
#: Number of time constants after which the start of a lag has almost no effect: exp(-40) = 4e-18.
_AT_REST = 40.0
#: Relative accuracy at which the search for a force stops.
_FOUND = 4e-16
#: Relative agreement between a chord's time constant and that at its end, and the maximum number of corrections.
_AGREEMENT = 1e-5
_MOST_CORRECTIONS = 10
#: Smallest slope of a secant that is used.
_LEAST_BEND = 0.2
#: Relative rounding error of a force.
_ROUNDING = 1e-9
#: A Newton step smaller than this share of the whole ends the search, because its error is of second order.
_NEAR = 1e-9


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """Return alpha = 1: the spring transmits the whole force of the valves."""
    return 1.0


def advance_core(lagged: float, piece: Piece, own: tuple[float, ...], valve: Valve) -> float:
    """Return F [N] after a piece; own = (k,).

    The piece is divided into parts in which w changes by at most `STRAIGHT` and does not pass a kink. In each part the
    curve is replaced by its chord, for which the equation is a first-order lag and is solved exactly; a correction
    accounts for the deviation of the curve from the chord. So the step is of second order, across kinks too, and exact
    for a straight curve, and for any step w stays between its bounding velocities.
    """
    w = velocity_under(lagged, piece.velocity_start, piece.static_start, valve)
    force, time = lagged, 0.0
    most = max(STRAIGHT, 6.0 * _reach(w, piece.velocity_start, piece.velocity_end) / _MOST_PARTS)
    for part in range(_MOST_PARTS):
        v, left = _velocity_at(piece, time), piece.step - time
        gap, last = v - w, piece.velocity_end - w
        if (gap == 0.0 and last == 0.0) or left <= 0.0:
            return force
        if gap * last < 0.0 and abs(gap) > _SHORTEST:  # w will turn: first advance to where v = w
            left, last = left * (gap / (gap - last)), 0.0
        towards = gap if abs(gap) >= abs(last) else last
        far, room = abs(towards), _room_before_kink(w, towards, valve)
        tau = _time_constant(w, force, copysign(min(far, most, room), towards), own[0], valve)
        if far > most and part < _MOST_PARTS - 1:
            if tau == 0.0:  # the curve is flat, so w crosses it at once
                w += copysign(min(most, room), towards)
                force = valve_force(valve, w)
                continue
            left = min(left, _time_for(most, abs(gap), far, left, tau))
        end = piece.velocity_end if time + left >= piece.step else _velocity_at(piece, time + left)
        tau = _chord_time_constant(w, force, tau, v, end, left, room, own[0], valve)
        change = _followed(w, v, end, tau, left) - w
        if abs(change) > room:
            whole = left
            left = _time_across(room, abs(change), w, v, end, tau, whole)
            change = copysign(room, change)
            gained = _bow_of_curve(w, force, change, tau, left, own[0], valve)
            left = min(_time_less_bow(left, gained, tau, v + (end - v) * (left / whole) - (w + change)), whole)
        else:
            # Once w follows the velocity at a constant distance, only the velocity's ramp changes w at an even rate.
            even = 1.0 if left < _AT_REST * tau else min(abs(end - v) / max(abs(change), _SHORTEST), 1.0)
            change += even * _bow_of_curve(w, force, change, tau, left, own[0], valve)
        after = w + copysign(min(abs(change), room), change)
        after = min(max(after, min(w, v, end)), max(w, v, end))
        change = valve_force(valve, after) - force
        most_change = own[0] * left * far + _ROUNDING * abs(force)  # |dF/dt| is at most k far
        if abs(change) > most_change:  # the curve falls a little here, and w crosses the dip at once
            after = velocity_under(force + copysign(most_change, change), w, force, valve)
        w, force = after, valve_force(valve, after)
        time = piece.step if time + left >= piece.step else time + left
    return force


def _velocity_at(piece: Piece, time: float) -> float:
    """Return v [m/s] at a time [s] after the start of a piece."""
    return piece.velocity_start + (piece.velocity_end - piece.velocity_start) * (time / piece.step)


def _reach(w: float, v: float, end: float) -> float:
    """Return the largest distance of w [m/s] from the velocity while that changes linearly from v to end [m/s]."""
    return max(abs(v - w), abs(end - w))


def _time_for(change: float, gap: float, far: float, left: float, tau: float) -> float:
    """Return a time [s] in which w changes by at most `change` while v - w grows from gap to far [m/s] over `left`.

    |dw/dt| is at most far / tau, and until the gap has doubled on average at most 1.5 gap / tau; w never passes v.
    """
    gap = max(gap, _SHORTEST)
    growth = max(far - gap, _SHORTEST) / left
    lagging = max(tau * change / far, min(tau * change / (1.5 * gap), gap / growth))
    return max(lagging, (change - gap) / growth)


def _time_constant(w: float, force: float, change: float, stiffness: float, valve: Valve) -> float:
    """Return tau [s]: the slope of the chord from w [m/s], where F = `force` [N], over a change of w, over k."""
    there = w + (change if abs(change) > _SHORTEST else copysign(_SHORTEST, change))
    return max((valve_force(valve, there) - force) / (there - w) / stiffness, 0.0)


def _room_before_kink(w: float, towards: float, valve: Valve) -> float:
    """Return the distance [m/s] from w [m/s] to the next kink of the curve in a direction; infinite if none follows."""
    side = copysign(1.0, towards)
    curve, half = valve.curve, 0.5 * valve.curve.transition_width
    inside, outside = curve.transition_speed - half, curve.transition_speed + half
    if curve.knot_velocity[KNOTS - 1] > 0.0:  # a spline has no transition
        inside = outside = 0.0
    room = inf
    for kink in (-curve.rebound_speed, -outside, -inside, 0.0, inside, outside, curve.compression_speed):
        distance = side * (kink - w)
        if _SHORTEST < distance < room and (kink != 0.0 or valve.compression_scale != valve.rebound_scale):
            room = distance
    return room


def _chord_time_constant(
    w: float, force: float, tau: float, v: float, end: float, step: float, room: float, stiffness: float, valve: Valve
) -> float:
    """Return tau [s] of the chord from w [m/s] to its value after `step` [s], or to the kink `room` [m/s] away.

    The velocity changes from v to end [m/s]. The search starts from the given tau and continues by secants.
    """
    before, miss_before = tau, 0.0
    for tries in range(_MOST_CORRECTIONS):
        change = _followed(w, v, end, tau, step) - w
        if change == 0.0:
            return tau
        found = _time_constant(w, force, copysign(min(abs(change), room), change), stiffness, valve)
        miss = found - tau
        bend = 0.0 if tries == 0 else (miss_before - miss) / (tau - before)  # 1 where the chord is that of any tau
        after = tau + miss / bend if bend > _LEAST_BEND else found
        before, miss_before, tau = tau, miss, max(after, 0.0)
        if abs(miss) <= _AGREEMENT * found:
            return tau
    return tau


def _bow_of_curve(
    w: float, force: float, change: float, tau: float, step: float, stiffness: float, valve: Valve
) -> float:
    """Return the correction [m/s] to a change of w [m/s] in `step` [s] for the curve's deviation from its chord.

    The deviation is modelled as a parabola, with w changing at an even rate. With z = step / tau its factor is that of
    the exact integral for small z, z / 6 - z^2 / 12 + ..., and for large z, 1 / z.
    """
    bow = valve_force(valve, w + 0.5 * change) - (force + 0.5 * stiffness * tau * change)
    return 4.0 * bow * step / (stiffness * (6.0 * tau * tau + 3.0 * tau * step + step * step))


def _time_across(room: float, change: float, w: float, v: float, end: float, tau: float, step: float) -> float:
    """Return the time [s] after which w [m/s] has moved by `room`; after `step` [s] it has moved by `change` [m/s].

    Newton's method inside a bracket is used: w is monotonic and either convex or concave in time.
    """
    low, high, time = 0.0, step, step * (room / change)
    for _ in range(_MOST_TRIES):
        here = v + (end - v) * (time / step)
        after = _followed(w, v, here, tau, time)
        miss = abs(after - w) - room
        if miss > 0.0:
            high = time
        else:
            low = time
        rate = abs(here - after)
        there = time - miss * tau / rate if rate > 0.0 else low
        is_newton = low < there < high
        if not is_newton:
            there = 0.5 * (low + high)
        if abs(there - time) <= (_NEAR if is_newton else _FOUND) * step:
            return there
        time = there
    return time


def _time_less_bow(time: float, gained: float, tau: float, gap: float) -> float:
    """Return the time [s] of a crossing at which w is ahead by `gained` [m/s] and changes at the rate gap / tau.

    The time is not reduced by more than half: where w barely changes, this linear estimate is not valid.
    """
    earlier = gained * tau
    return time - earlier / gap if abs(earlier) < 0.5 * abs(gap) * time else time


def _followed(w: float, v: float, end: float, tau: float, step: float) -> float:
    """Return w [m/s] after `step` [s] of tau dw/dt = v(t) - w, with v linear in time up to end [m/s]; tau may be 0."""
    if step >= _SETTLED * tau:
        return end - (end - v) * (tau / step)
    return advance(w, v, end, tau, step)


def velocity_under(force: float, guess: float, guess_force: float, valve: Valve) -> float:
    """Return w [m/s] with f(w) = `force` [N], by secants inside a bracket, from a guess [m/s] with its force [N]."""
    before, before_miss = guess, guess_force - force
    if before_miss == 0.0:
        return guess
    low, high = (-inf, guess) if before_miss > 0.0 else (guess, inf)
    here = guess - copysign(_FIRST, before_miss)
    for _ in range(_MOST_TRIES):
        miss = valve_force(valve, here) - force
        if abs(miss) <= _FOUND * abs(force) or miss == before_miss or here == before:
            return here
        low, high = (low, min(high, here)) if miss > 0.0 else (max(low, here), high)
        there = here - miss * (here - before) / (miss - before_miss)
        if not low < there < high:
            there = 0.5 * (low + high) if high - low < inf else here + 2.0 * (here - before)
        before, before_miss, here = here, miss, there
    return here


@dataclass(frozen=True, slots=True)
class Maxwell(ShockLaw):
    """F = f(w) with dF/dt = k (v - w).

    Args:
        series_stiffness: k [N/m] at the damper. With the slope c of the curve the lag is c / k.

    Raises:
        ValueError: A parameter is out of range, or the curve is not strictly rising, so that w does not follow from F.
    """

    series_stiffness: float

    def __post_init__(self) -> None:
        if not (isfinite(self.series_stiffness) and self.series_stiffness > 0.0):
            raise ValueError(
                f"series_stiffness must be positive, not {self.series_stiffness!r}; for a rigid series use Polylinear"
            )
        for name in ("compression_scale", "rebound_scale"):
            if getattr(self.port, name) <= 0.0:
                raise ValueError(f"port: {name} must be positive for a Maxwell law, whose curve must rise everywhere")
        falls = self.curve.falls_at()
        if falls is not None:
            raise ValueError(
                f"curve: the force does not rise with velocity at {falls:.4g} m/s ({self.curve.force(falls):.4g} N), "
                "and a Maxwell law needs a curve that rises everywhere; fit a monotone curve, or use LPF1 or LPNL2"
            )

    def lag_weight(self, static_force: float) -> float:
        """Return alpha = 1: the force is the lagged force."""
        return weight_core(static_force, (self.series_stiffness,))

    def advance_piece(self, lagged: float, piece: Piece) -> float:
        """Solve dF/dt = k (v - w) over a piece."""
        return advance_core(lagged, piece, (self.series_stiffness,), self.valve)

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Return F_lag [N] if only static forces are known: the velocities are those at which the curve has them."""
        start = velocity_under(static_start, 0.0, 0.0, self.valve)
        end = start if static_end == static_start else velocity_under(static_end, start, static_start, self.valve)
        return self.advance_piece(lagged, Piece(start, end, static_start, static_end, step))
