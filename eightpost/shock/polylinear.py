"""Polylinear: F = f(v), a curve without lag (Eq 3.23). Standard library only: the FMU contains a copy of this file."""

from __future__ import annotations

from dataclasses import dataclass

from .law import FitParameter, Piece, ShockLaw, Valve

FIT_FORM = "no lag"

FIT_PARAMETERS: tuple[FitParameter, ...] = ()


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """Return alpha = 0: the force has no lagged part."""
    return 0.0


def advance_core(lagged: float, piece: Piece, own: tuple[float, ...], valve: Valve) -> float:
    """Return F_lag = F_s: there is no lag."""
    return piece.static_end


@dataclass(frozen=True, slots=True)
class Polylinear(ShockLaw):
    """F = F_s = f(v)."""

    def lag_weight(self, static_force: float) -> float:
        """Return alpha = 0: the force has no lagged part."""
        return weight_core(static_force, ())

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Return F_lag = F_s: there is no lag."""
        return static_end
