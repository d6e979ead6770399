"""What every shock law has in common: a static curve, a lagged force, an output weight, a port.

Standard library only: the FMU ships this very file. A law says two things: how its lagged force follows the velocity
and the static force (`advance_lag`, `advance_piece`) and how much of the lagged force the shock gives (`lag_weight`).

A law's file is all that the library needs of it (docs/add_a_law.md). Beside its class it has, at module level:

- `weight_core(static_force, own) -> alpha` and `advance_core(lagged, piece, own, valve) -> F_lag`: its numbers, as
  functions of floats and the tuples below. The class calls them, and a fit compiles the very same ones. `own` are the
  law's own parameters, in the order of its fields.
- `FIT_PARAMETERS`: a `FitParameter` for each of those.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from .curve import CurveNumbers, StaticCurve, curve_force
from .port import Port

#: Largest change of damper velocity [m/s] over which `follow` takes F_s as a straight line, and its most pieces.
STRAIGHT = 0.01
MOST_PIECES = 1000


class FitParameter(NamedTuple):
    """How a law's own parameter is fitted where the record does not say better."""

    name: str
    """Of the field."""
    unit: str
    low: float
    start: float
    high: float
    """The bounds and the first guess, in `unit`."""
    scale: str
    """"logarithmic" or "linear": in what the search takes its steps."""
    above: str = ""
    """The name of the parameter that must stay below this one, if there is one, ..."""
    gap: float = 0.0
    """... by at least this much, in `unit`."""


class Valve(NamedTuple):
    """The static force over damper velocity, scales included: what a law's core may ask for."""

    curve: CurveNumbers | StaticCurve
    compression_scale: float
    rebound_scale: float


class Piece(NamedTuple):
    """A short stretch of time in which velocity and static force go linearly from start to end."""

    velocity_start: float
    velocity_end: float
    """Of the damper [m/s]."""
    static_start: float
    static_end: float
    """F_s there [N]."""
    step: float
    """[s]."""


def valve_force(valve: Valve, velocity: float) -> float:
    """Return F_s [N] at a damper velocity [m/s]."""
    scale = valve.compression_scale if velocity > 0.0 else valve.rebound_scale
    return scale * curve_force(valve.curve, velocity)


class Response(NamedTuple):
    """A shock's outputs at one instant; the names are those of docs/ports.md."""

    force: float
    """At the port [N], positive in compression."""
    static_force: float
    """F_s [N]."""
    lagged_force: float
    """F_lag [N]."""
    lag_weight: float
    """alpha [1]."""
    dissipated_power: float
    """Valve and seal force times damper velocity [W]; without the gas spring."""
    beyond_fit: float
    """1 while the damper velocity is outside the fitted range, else 0."""


@dataclass(frozen=True, slots=True)
class ShockLaw(ABC):
    """F = alpha F_lag + (1 - alpha) F_s at the valves (the form of Eq 3.25), plus gas and seal, through the port."""

    curve: StaticCurve
    port: Port = field(default_factory=Port, kw_only=True)

    @abstractmethod
    def lag_weight(self, static_force: float) -> float:
        """Return alpha [1] at a static force F_s [N]."""

    @abstractmethod
    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Return F_lag [N] after `step` [s] in which F_s goes linearly from start to end [N]."""

    def advance_piece(self, lagged: float, piece: Piece) -> float:
        """Return F_lag [N] after a piece; for a law that asks for velocities too."""
        return self.advance_lag(lagged, piece.static_start, piece.static_end, piece.step)

    @property
    def valve(self) -> Valve:
        """The static force over damper velocity, as a core takes it."""
        return Valve(self.curve, self.port.compression_scale, self.port.rebound_scale)

    def static_force(self, velocity: float) -> float:
        """Return F_s [N] of the damper at a port velocity [m/s]; also the lagged force in equilibrium."""
        damper_velocity = self.port.motion_ratio * velocity
        return self.port.scale(damper_velocity) * self.curve.force(damper_velocity)

    def advance(self, lagged: float, velocity_start: float, velocity_end: float, step: float) -> float:
        """Return F_lag [N] after `step` [s]; F_s goes linearly between its values at the two port velocities [m/s]."""
        static_end = self.static_force(velocity_end)
        static_start = static_end if velocity_start == velocity_end else self.static_force(velocity_start)
        return self.advance_piece(lagged, self._piece(velocity_start, velocity_end, static_start, static_end, step))

    def follow(self, lagged: float, velocity_start: float, velocity_end: float, step: float) -> float:
        """Return F_lag [N] after `step` [s] in which the port velocity [m/s] goes linearly from start to end.

        F_s is a chain of straight lines, each over at most `STRAIGHT` of damper velocity; a velocity that is held
        takes one, and is exact.
        """
        count = self._pieces(velocity_start, velocity_end)
        here, before = velocity_start, self.static_force(velocity_start)
        for k in range(1, count + 1):
            share = k / count
            there = velocity_end if k == count else velocity_start + (velocity_end - velocity_start) * share
            after = before if there == here else self.static_force(there)
            lagged = self.advance_piece(lagged, self._piece(here, there, before, after, step / count))
            here, before = there, after
        return lagged

    def _piece(self, start: float, end: float, static_start: float, static_end: float, step: float) -> Piece:
        ratio = self.port.motion_ratio
        return Piece(ratio * start, ratio * end, static_start, static_end, step)

    def _pieces(self, velocity_start: float, velocity_end: float) -> int:
        change = abs(self.port.motion_ratio * (velocity_end - velocity_start)) / STRAIGHT
        return 1 if change < 1.0 else MOST_PIECES if change >= MOST_PIECES else int(change) + 1

    def response(self, lagged: float, velocity: float, displacement: float) -> Response:
        """Return the outputs for a lagged force [N] at a port velocity [m/s] and displacement [m]."""
        port = self.port
        damper_velocity = port.motion_ratio * velocity
        static = self.static_force(velocity)
        weight = self.lag_weight(static)
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
    """Refuse a time constant [s] that is not positive and finite."""
    if not (isfinite(time_constant) and time_constant > 0.0):
        raise ValueError(f"time_constant must be positive, not {time_constant!r}; for no lag use the Polylinear law")
