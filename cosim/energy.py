"""The energy that a bond creates or loses because its two ends see different values within a step."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.conversion import to_si
from cosim.coupling import Coupling
from cosim.system import Bond, System


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


class EnergyMeter:
    """Adds up both ends of one bond, step by step, in SI, by the trapezoidal rule."""

    def __init__(self, bond: Bond, system: System) -> None:
        velocity, force = bond.velocity, bond.force
        self._names = (velocity.source, force.target, force.source, velocity.target)
        conversions = [to_si(system.output(name))[0] for name in self._names]
        self._scales = (
            conversions[0].factor * conversions[1].factor,
            conversions[2].factor * conversions[3].factor,
        )
        self._residual = self._transferred = 0.0

    def add(self, coupling: Coupling, before: dict[str, float], step: float) -> None:
        """Add a step: `before` holds the outputs at its start, `coupling.now` those at its end."""
        out, used, now = self._names, coupling.used, coupling.now
        given = _mean((before[out[0]], now[out[0]])) * _mean(used[out[1]]) * self._scales[0] * step
        taken = _mean((before[out[2]], now[out[2]])) * _mean(used[out[3]]) * self._scales[1] * step
        self._residual += given - taken
        self._transferred += abs(taken)

    @property
    def total(self) -> BondEnergy:
        """What has been added up so far."""
        return BondEnergy(self._residual, self._transferred)


def _mean(pair: tuple[float, float]) -> float:
    return 0.5 * (pair[0] + pair[1])
