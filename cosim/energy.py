"""The energy that a bond creates or loses because its two ends see different values within a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cosim.conversion import to_si
from cosim.coupling import Coupling, Term
from cosim.system import Bond, Connection, System

#: Residual, as a share of the energy transferred, from which a run deserves a second one at half the step.
DOUBTFUL = 1e-2

#: Largest residual, as a share of the energy transferred, of a result that can be used. With ramped values the residual
#: was about the error of the shock velocity: 0.25 % at 1 ms, 0.9 % at 2 ms, 3.4 % at 4 ms (docs/coupling.md).
LIMIT = 0.05


@dataclass(frozen=True, slots=True)
class BondEnergy:
    """Energy through one bond over a run.

    Args:
        residual: Energy given at the velocity end less energy taken at the force end [J]; 0 in exact coupling.
        transferred: Sum of the magnitudes of the energy taken at the force end in each step [J].
    """

    residual: float
    transferred: float

    @property
    def relative(self) -> float:
        """The residual as a share of the energy transferred [1]."""
        return self.residual / self.transferred if self.transferred else 0.0

    @property
    def acceptable(self) -> bool:
        """Whether the coupling neither makes nor loses more than 5 % of the energy that goes through it."""
        return abs(self.relative) <= LIMIT


class EnergyMeter:
    """Adds up both ends of one bond, step by step, in SI, by the trapezoidal rule.

    Only what this bond itself feeds counts: other sources of a sum have meters of their own.
    """

    def __init__(self, bond: Bond, system: System, coupling: Coupling) -> None:
        self._velocity, self._force = (
            _Way(connection, system, coupling.term(connection.source, connection.target))
            for connection in (bond.velocity, bond.force)
        )
        self._residual = self._transferred = 0.0

    def add(self, coupling: Coupling, before: Mapping[str, float], step: float) -> None:
        """Add a step: `before` holds the outputs at its start, `coupling.now` those at its end."""
        given = self._velocity.sent(before, coupling.now) * self._force.received(coupling) * step
        taken = self._force.sent(before, coupling.now) * self._velocity.received(coupling) * step
        self._residual += given - taken
        self._transferred += abs(taken)

    @property
    def total(self) -> BondEnergy:
        """What has been added up so far."""
        return BondEnergy(self._residual, self._transferred)


class _Way:
    """One direction of a bond: what its source sent and what its target received, means over the step, SI."""

    def __init__(self, connection: Connection, system: System, term: Term) -> None:
        self._source, self._component = connection.source, connection.target.partition(".")[0]
        self._term = term
        self._source_factor = to_si(system.output(connection.source))[0].factor
        self._target_factor = to_si(system.output(connection.target))[0].factor

    def sent(self, before: Mapping[str, float], now: Mapping[str, float]) -> float:
        return 0.5 * (before[self._source] + now[self._source]) * self._source_factor

    def received(self, coupling: Coupling) -> float:
        start, end = coupling.fed[self._component]
        return 0.5 * (self._term(start) + self._term(end)) * self._target_factor
