"""The base of all shock laws: a static curve, a lagged force, an output weight, a port.

Standard library only: the FMU contains a copy of this file. A law defines how its lagged force follows the velocity
and the static force (`advance_lag`, `advance_piece`) and the weight of the lagged force in the output (`lag_weight`).
A law with several states also defines their start (`start`) and the force of the valves (`valve_force`).

A law is a single file (docs/development/add_a_law.md). Besides its class, the file has at module level:

- `weight_core(static_force, own) -> alpha` and `advance_core(lagged, piece, own, valve) -> F_lag`: its equations, as
  functions of floats and the tuples below. The class calls them, and a fit compiles the same functions. `own` are the
  law's own parameters, in the order of its fields.
- In a law with several states: their names `STATES`, `start_core(velocity, static_force, own, valve) -> states`,
  `advance_core(states, piece, own, valve) -> states` and `force_core(states, velocity, static_force, own, valve) ->
  F_v`; states are tuples of floats. If own parameters are tuples, `SIZES` has their numbers of values by name, and
  `own` contains these values one after the other.
- `FIT_PARAMETERS`: a `FitParameter` for each of these parameters. If it has not all of them, `UNITS` has their units by
  name.
- `FIT_FORM`, optional: closed form of the same equations, with which a fit is faster. "no lag": F = F_s. "lag": the
  lag of `advance`, alpha = 1; the first parameter is tau. "fading lag": alpha is 1 up to the second parameter F_1 and
  0 above the third F_2; `weight_slopes_core(static_force, factor, own)` in the file returns its derivatives by F_s, F_1
  and F_2, each times the factor. The fit evaluates both functions of alpha for arrays, with the `min`, `max` and
  `copysign` of numpy: they have no branches.
  "lagged velocity": the law has a recipe of its own (eightpost/ident/shock/hysteresis.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from math import expm1, isfinite, tanh
from typing import Any, NamedTuple

from .curve import CurveNumbers, StaticCurve, curve_force


def advance(lagged: float, static_start: float, static_end: float, time_constant: float, step: float) -> float:
    """Return F_lag [N] after a step in which F_s changes linearly from `static_start` to `static_end` [N].

        F_lag(h) = F_lag + (F_s0 - F_lag)(1 - e) + (F_s1 - F_s0)(1 - (1 - e) tau / h),   e = exp(-h / tau)

    Args:
        lagged: F_lag at the start of the step [N].
        static_start: F_s at the start [N].
        static_end: F_s at the end [N].
        time_constant: tau [s], positive.
        step: h [s], positive.

    >>> advance(0.0, 100.0, 100.0, 0.0013, 0.0013)  # one time constant: 1 - 1/e of the way
    63.212055882855765
    """
    ratio = step / time_constant
    rise = -expm1(-ratio)
    return lagged + (static_start - lagged) * rise + (static_end - static_start) * (1.0 - rise / ratio)


@dataclass(frozen=True, slots=True, repr=False)
class Port:
    """The parameters that all shock laws share.

    Raises:
        ValueError: A value is not finite or outside its range; the message names it.
    """

    #: Damper travel per port travel [1]: damper velocity = motion_ratio * velocity, port force = motion_ratio * damper
    #: force.
    motion_ratio: float = 1.0
    compression_scale: float = 1.0  #: Factor on the static force in compression [1].
    rebound_scale: float = 1.0  #: Factor on the static force in rebound [1].
    gas_stiffness: float = 0.0  #: Parallel gas spring at the damper [N/m] (K of Eq 3.14).
    gas_preload: float = 0.0  #: Gas force at zero displacement [N] (F_0 of Eq 3.14).
    seal_friction: float = 0.0  #: Coulomb drag [N] (3.4.3), smoothed as tanh(v / friction_velocity).
    friction_velocity: float = 0.005  #: Width of the smoothing [m/s].

    def __repr__(self) -> str:
        """Return the parameters that differ from their defaults, as an expression."""
        stated = ((one.name, getattr(self, one.name), one.default) for one in fields(self))
        return f"Port({', '.join(f'{name}={value!r}' for name, value, default in stated if value != default)})"

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not isfinite(getattr(self, name)):
                raise ValueError(f"port: {name} must be finite, not {getattr(self, name)!r}")
        for name in ("motion_ratio", "friction_velocity"):
            if getattr(self, name) <= 0.0:
                raise ValueError(f"port: {name} must be positive, not {getattr(self, name)!r}")
        for name in ("compression_scale", "rebound_scale", "gas_stiffness", "seal_friction"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"port: {name} must not be negative, not {getattr(self, name)!r}")

    def scale(self, damper_velocity: float) -> float:
        """Return the factor on the static force [1] at a damper velocity [m/s]."""
        return self.compression_scale if damper_velocity > 0.0 else self.rebound_scale

    def seal_force(self, damper_velocity: float) -> float:
        """Return the seal drag [N] at a damper velocity [m/s]."""
        return self.seal_friction * tanh(damper_velocity / self.friction_velocity)

    def gas_force(self, displacement: float) -> float:
        """Return the gas force at the damper [N] at a port displacement [m] (Eq 3.14: K x + F_0)."""
        return self.gas_preload + self.gas_stiffness * self.motion_ratio * displacement


#: Largest change of damper velocity [m/s] over which `follow` treats F_s as linear, and its maximum number of pieces.
STRAIGHT = 0.01
MOST_PIECES = 1000


State = Any  #: State of a law between steps: F_lag [N], or a tuple of floats if the law has several states.


class FitParameter(NamedTuple):
    """Defaults for fitting one of a law's own parameters, used unless the record gives better ones."""

    name: str  #: Name of the field.
    unit: str  #: SI unit.
    low: float  #: Lower bound, in `unit` as the following.
    start: float  #: Starting value.
    high: float  #: Upper bound.
    scale: str  #: "logarithmic" or "linear": scale of the steps of the search.
    above: str = ""  #: Name of the parameter that must stay below this one; empty without such a condition.
    gap: float = 0.0  #: Minimum distance to the parameter named by `above`.


class Valve(NamedTuple):
    """The static force over damper velocity, including scales, as passed to `advance_core`."""

    curve: CurveNumbers | StaticCurve
    compression_scale: float
    rebound_scale: float


class Piece(NamedTuple):
    """A short piece of time in which velocity and static force change linearly from start to end."""

    velocity_start: float  #: Damper velocity at the start [m/s].
    velocity_end: float  #: Damper velocity at the end [m/s].
    static_start: float  #: F_s at the start [N].
    static_end: float  #: F_s at the end [N].
    step: float  #: Duration [s].


def valve_force(valve: Valve, velocity: float) -> float:
    """Return F_s [N] at a damper velocity [m/s]."""
    scale = valve.compression_scale if velocity > 0.0 else valve.rebound_scale
    return scale * curve_force(valve.curve, velocity)


class Response(NamedTuple):
    """A shock's outputs at one instant; the names are those of docs/reference/ports.md."""

    force: float  #: Force at the port [N], positive in compression.
    static_force: float  #: F_s [N].
    lagged_force: float  #: F_lag [N].
    lag_weight: float  #: alpha [1].
    dissipated_power: float  #: Valve and seal force times damper velocity [W]; without the gas spring.
    beyond_fit: float  #: 1 while the damper velocity is outside the fitted range, else 0.


@dataclass(frozen=True, slots=True)
class ShockLaw(ABC):
    """F = alpha F_lag + (1 - alpha) F_s at the valves (the form of Eq 3.25), plus gas and seal, through the port."""

    curve: StaticCurve
    port: Port = field(default_factory=Port, kw_only=True)

    @abstractmethod
    def lag_weight(self, static_force: float) -> float:
        """Return alpha [1] at a static force F_s [N]."""

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Return F_lag [N] after `step` [s] in which F_s changes linearly from start to end [N].

        Raises:
            TypeError: The lagged force of the law does not follow from static forces alone.
        """
        raise TypeError(f"{type(self).__name__} does not follow from static forces alone; use advance_piece")

    def advance_piece(self, state: State, piece: Piece) -> State:
        """Return the state after a piece; override it in a law that needs velocities."""
        return self.advance_lag(state, piece.static_start, piece.static_end, piece.step)

    def start(self, velocity: float) -> State:
        """Return the state of steady motion at a port velocity [m/s]; F_lag = F_s unless the law overrides it."""
        return self.static_force(velocity)

    def valve_force(self, state: State, velocity: float) -> float:
        """Return F_lag [N] in a state at a port velocity [m/s]; a law with several states overrides it."""
        lagged: float = state
        return lagged

    @property
    def valve(self) -> Valve:
        """The static force over damper velocity, in the form that `advance_core` takes."""
        return Valve(self.curve, self.port.compression_scale, self.port.rebound_scale)

    def static_force(self, velocity: float) -> float:
        """Return F_s [N] of the damper at a port velocity [m/s]; also the lagged force in equilibrium."""
        damper_velocity = self.port.motion_ratio * velocity
        return self.port.scale(damper_velocity) * self.curve.force(damper_velocity)

    def advance(self, state: State, velocity_start: float, velocity_end: float, step: float) -> State:
        """Return the state after `step` [s]; F_s changes linearly between its values at the port velocities [m/s]."""
        static_end = self.static_force(velocity_end)
        static_start = static_end if velocity_start == velocity_end else self.static_force(velocity_start)
        return self.advance_piece(state, self._piece(velocity_start, velocity_end, static_start, static_end, step))

    def follow(self, state: State, velocity_start: float, velocity_end: float, step: float) -> State:
        """Return the state after `step` [s] in which the port velocity [m/s] changes linearly from start to end.

        F_s is approximated by straight lines, each over at most `STRAIGHT` of damper velocity; a held velocity takes
        one line and is exact.
        """
        change = abs(self.port.motion_ratio * (velocity_end - velocity_start)) / STRAIGHT
        count = 1 if change < 1.0 else MOST_PIECES if change >= MOST_PIECES else int(change) + 1
        here, before = velocity_start, self.static_force(velocity_start)
        for k in range(1, count + 1):
            share = k / count
            there = velocity_end if k == count else velocity_start + (velocity_end - velocity_start) * share
            after = before if there == here else self.static_force(there)
            state = self.advance_piece(state, self._piece(here, there, before, after, step / count))
            here, before = there, after
        return state

    def _piece(self, start: float, end: float, static_start: float, static_end: float, step: float) -> Piece:
        ratio = self.port.motion_ratio
        return Piece(ratio * start, ratio * end, static_start, static_end, step)

    def response(self, state: State, velocity: float, displacement: float) -> Response:
        """Return the outputs in a state at a port velocity [m/s] and displacement [m]."""
        port = self.port
        damper_velocity = port.motion_ratio * velocity
        static = self.static_force(velocity)
        weight, lagged = self.lag_weight(static), self.valve_force(state, velocity)
        dissipative = weight * lagged + (1.0 - weight) * static + port.seal_force(damper_velocity)
        return Response(
            force=port.motion_ratio * (dissipative + port.gas_force(displacement)),
            static_force=static,
            lagged_force=lagged,
            lag_weight=weight,
            dissipated_power=dissipative * damper_velocity,
            beyond_fit=1.0 if self.curve.is_beyond_fit(damper_velocity) else 0.0,
        )


def check_time_constant(time_constant: float) -> None:
    """Raise ValueError if a time constant [s] is not positive and finite."""
    if not (isfinite(time_constant) and time_constant > 0.0):
        raise ValueError(f"time_constant must be positive, not {time_constant!r}; for no lag use the Polylinear law")
