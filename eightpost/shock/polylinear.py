"""Polylinear: F = f(v), a curve without lag (Eq 3.23). Standard library only: the FMU ships this very file."""

from __future__ import annotations

from dataclasses import dataclass

from .law import ShockLaw


@dataclass(frozen=True, slots=True)
class Polylinear(ShockLaw):
    """F = F_s = f(v)."""

    def lag_weight(self, static_force: float) -> float:
        """alpha = 0: nothing of the lagged force is given."""
        return 0.0

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """F_lag = F_s: there is no lag."""
        return static_end
