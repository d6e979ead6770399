"""LPF1: tau dF/dt = F_s - F, a curve behind a first-order lag (Eq 3.24).

Standard library only: the FMU contains a copy of this file.
"""

from __future__ import annotations

from dataclasses import dataclass

from .law import FitParameter, Piece, ShockLaw, Valve, advance, check_time_constant

FIT_FORM = "lag"
#: The bounds of 3.3.2: 0.1 to 10 ms.
FIT_PARAMETERS = (FitParameter("time_constant", "s", low=1e-4, start=1e-3, high=1e-2, scale="logarithmic"),)


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """Return alpha = 1: the force is the lagged force."""
    return 1.0


def advance_core(lagged: float, piece: Piece, own: tuple[float, ...], valve: Valve) -> float:
    """Solve Eq 3.24 over a piece; own = (tau,)."""
    return advance(lagged, piece.static_start, piece.static_end, own[0], piece.step)


@dataclass(frozen=True, slots=True)
class Lpf1(ShockLaw):
    """F = F_lag with tau dF_lag/dt = F_s - F_lag."""

    time_constant: float  #: tau [s]; 1.3 ms for build 1 (3.3.2).

    def __post_init__(self) -> None:
        check_time_constant(self.time_constant)

    def lag_weight(self, static_force: float) -> float:
        """Return alpha = 1: the force is the lagged force."""
        return weight_core(static_force, (self.time_constant,))

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Solve Eq 3.24 over a piece."""
        return advance(lagged, static_start, static_end, self.time_constant, step)
