"""Maxwell: the static curve and a stiffness in series. Standard library only: the FMU ships this very file.

The oil and the hoses give way before the valves open: the piston moves with v, the oil through the valves with w, and
the difference strains the spring,

    dF/dt = k (v - w),   F = f(w),   so that   (f'(w) / k) dw/dt = v - w

with f the static force over velocity. Where the curve is straight this is LPF1 with tau = f'/k; where it is flat, w = v
at once; for k without bound it is Polylinear.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, isfinite

from .lag import advance
from .law import STRAIGHT, FitParameter, Piece, ShockLaw, Valve, valve_force

#: From rubber-soft to a hundred times an oil column's.
FIT_PARAMETERS = (FitParameter("series_stiffness", "N/m", low=1e5, start=3e6, high=1e9, scale="logarithmic"),)

#: The shortest chord, and the first of the search for a velocity [m/s].
_SHORTEST = 1e-9
_FIRST = 1e-3
#: Most pieces of a piece, and most steps of the search for a velocity; far more than any curve takes.
_MOST_PARTS = 1000
_MOST_TRIES = 100
#: From so many time constants on, nothing is left of where a lag began: exp(-1000) = 0.
_SETTLED = 1000.0
#: Where the force is known to so many of itself, it is found.
_FOUND = 4e-16


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """alpha = 1: all of the valves' force goes through the spring."""
    return 1.0


def advance_core(lagged: float, piece: Piece, own: tuple[float, ...], valve: Valve) -> float:
    """Return F [N] after a piece; own = (k,).

    The piece is gone through in parts in which w moves by at most `STRAIGHT`. In each the curve is its chord, under
    which the equation is a first-order lag and is solved exactly: second order in the step, exact for a straight curve,
    and w never leaves the velocities that it lies between, for any step.
    """
    w = velocity_under(lagged, piece.velocity_start, piece.static_start, valve)
    force, time = lagged, 0.0
    most = max(STRAIGHT, 2.0 * reach(w, piece.velocity_start, piece.velocity_end) / _MOST_PARTS)
    for part in range(_MOST_PARTS):
        v = velocity_at(piece, time)
        left = piece.step - time
        far = reach(w, v, piece.velocity_end)
        if far == 0.0 or left <= 0.0:
            return force
        towards = v - w if abs(v - w) >= abs(piece.velocity_end - w) else piece.velocity_end - w
        tau = time_constant(w, force, copysign(min(far, most), towards), own[0], valve)
        if far > most and part < _MOST_PARTS - 1:
            if tau == 0.0:  # flat: w is across it at once
                w += copysign(most, towards)
                force = valve_force(valve, w)
                continue
            left = min(left, tau * most / far)  # |dw/dt| is at most far / tau
        end = piece.velocity_end if time + left >= piece.step else velocity_at(piece, time + left)
        w = moved(w, force, tau, v, end, left, own[0], valve)
        force = valve_force(valve, w)
        time = piece.step if time + left >= piece.step else time + left
    return force


def velocity_at(piece: Piece, time: float) -> float:
    """Return v [m/s] at a time [s] after the start of a piece."""
    return piece.velocity_start + (piece.velocity_end - piece.velocity_start) * (time / piece.step)


def reach(w: float, v: float, end: float) -> float:
    """Return how far w [m/s] may go while the velocity goes from v to end [m/s]."""
    return max(abs(v - w), abs(end - w))


def time_constant(w: float, force: float, change: float, stiffness: float, valve: Valve) -> float:
    """Return tau [s]: the slope of the chord from w [m/s], where F = `force` [N], over a change of w, over k."""
    there = w + (change if abs(change) > _SHORTEST else copysign(_SHORTEST, change))
    return max((valve_force(valve, there) - force) / (there - w) / stiffness, 0.0)


def moved(
    w: float, force: float, tau: float, v: float, end: float, step: float, stiffness: float, valve: Valve
) -> float:
    """Return w [m/s] after `step` [s] in which the velocity goes from v to end [m/s] and the curve is straight.

    First with a tau [s] from nearby, then twice with that of the chord to where the last one led.
    """
    first = followed(w, v, end, tau, step)
    if first == w:
        return w
    second = followed(w, v, end, time_constant(w, force, first - w, stiffness, valve), step)
    if second == w:
        return w
    return followed(w, v, end, time_constant(w, force, second - w, stiffness, valve), step)


def followed(w: float, v: float, end: float, tau: float, step: float) -> float:
    """Return w [m/s] after `step` [s] of tau dw/dt = v(t) - w, v linear to end [m/s]; tau may be 0."""
    if step >= _SETTLED * tau:
        return end - (end - v) * (tau / step)
    return advance(w, v, end, tau, step)


def velocity_under(force: float, guess: float, guess_force: float, valve: Valve) -> float:
    """Return w [m/s] with f(w) = `force` [N], by secants inside a bracket; a guess [m/s] and its force [N] begin."""
    before, before_miss = guess, guess_force - force
    if before_miss == 0.0:
        return guess
    # A bound is of use once there is one on each side.
    low, high, bounds = guess, guess, 0
    slope = (valve_force(valve, guess + _FIRST) - guess_force) / _FIRST
    change = -before_miss / slope if slope > 0.0 else copysign(STRAIGHT, -before_miss)
    here = guess + change
    for _ in range(_MOST_TRIES):
        miss = valve_force(valve, here) - force
        if abs(miss) <= _FOUND * abs(force) or miss == before_miss or here == before:
            return here
        if (miss > 0.0) != (before_miss > 0.0) and bounds == 0:
            low, high, bounds = min(here, before), max(here, before), 1
        elif bounds == 1 and miss > 0.0:
            high = here
        elif bounds == 1:
            low = here
        there = here - miss * (here - before) / (miss - before_miss)
        if bounds == 1 and not low < there < high:
            there = 0.5 * (low + high)
        elif bounds == 0 and not (there - here) * miss < 0.0:
            there = here + copysign(2.0 * abs(here - before), -miss)
        before, before_miss, here = here, miss, there
    return here


@dataclass(frozen=True, slots=True)
class Maxwell(ShockLaw):
    """F = f(w) with dF/dt = k (v - w).

    Args:
        series_stiffness: k [N/m] at the damper. With the curve's slope c it gives the lag c / k.

    Raises:
        ValueError: A parameter is out of range, or the curve does not rise all over: w would not follow from F.
    """

    series_stiffness: float

    def __post_init__(self) -> None:
        if not (isfinite(self.series_stiffness) and self.series_stiffness > 0.0):
            raise ValueError(
                f"series_stiffness must be positive, not {self.series_stiffness!r}; for a rigid one use Polylinear"
            )
        for name in ("compression_scale", "rebound_scale"):
            if getattr(self.port, name) <= 0.0:
                raise ValueError(f"port: {name} must be positive under a Maxwell law: its curve must rise all over")
        falls = self.curve.falls_at()
        if falls is not None:
            raise ValueError(
                f"curve: the force does not rise with velocity at {falls:.4g} m/s ({self.curve.force(falls):.4g} N), "
                "and a Maxwell law needs a curve that rises all over; fit a monotone curve, or use LPF1 or LPNL2"
            )

    def lag_weight(self, static_force: float) -> float:
        """alpha = 1: all of the lagged force is given."""
        return weight_core(static_force, (self.series_stiffness,))

    def advance_piece(self, lagged: float, piece: Piece) -> float:
        """dF/dt = k (v - w)."""
        return advance_core(lagged, piece, (self.series_stiffness,), self.valve)

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """The same where only static forces are known: the velocities are those at which the curve gives them."""
        start = velocity_under(static_start, 0.0, 0.0, self.valve)
        end = start if static_end == static_start else velocity_under(static_end, start, static_start, self.valve)
        return self.advance_piece(lagged, Piece(start, end, static_start, static_end, step))
