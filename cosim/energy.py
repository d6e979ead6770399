"""Energy that a bond creates or loses because its two ends see different values within a step."""

from __future__ import annotations

from dataclasses import dataclass

#: Residual, as a share of the energy transferred, above which a second run at half the step is recommended.
DOUBTFUL = 1e-2

#: Largest residual, as a share of the energy transferred, of a result that can be used. With ramped values the residual
#: was about the error of the shock velocity: 0.25 % at 1 ms, 0.9 % at 2 ms, 3.4 % at 4 ms (docs/coupling.md).
LIMIT = 0.05


@dataclass(frozen=True, slots=True)
class BondEnergy:
    """Energy through one bond over a run.

    Args:
        residual: Energy given at the velocity end minus energy received at the force end [J]; 0 in exact coupling.
        transferred: Sum of the magnitudes of the energy received at the force end in each step [J].
    """

    residual: float
    transferred: float

    @property
    def relative(self) -> float:
        """Residual as a share of the energy transferred [1]."""
        return self.residual / self.transferred if self.transferred else 0.0

    @property
    def acceptable(self) -> bool:
        """Whether the coupling adds or loses at most 5 % of the energy transferred."""
        return abs(self.relative) <= LIMIT
