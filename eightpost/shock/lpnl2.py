"""LPNL2: lag at low force, none at high force (Eq 3.25). Standard library only: the FMU contains a copy of the file."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign

from .law import FitParameter, Piece, ShockLaw, Valve, advance, check_time_constant

FIT_FORM = "fading lag"
#: The bounds of 3.3.3: 0.1 to 10 ms, 10 to 1000 lbf, at least 1 lbf apart.
FIT_PARAMETERS = (
    FitParameter("time_constant", "s", low=1e-4, start=1e-3, high=1e-2, scale="logarithmic"),
    FitParameter("lag_full_force", "N", low=44.482216152605, start=500.0, high=4443.77339364524, scale="linear"),
    FitParameter(
        "lag_zero_force",
        "N",
        low=48.9304377678655,
        start=2500.0,
        high=4448.2216152605,
        scale="linear",
        above="lag_full_force",
        gap=4.4482216152605,
    ),
)


def weight_core(static_force: float, own: tuple[float, ...]) -> float:
    """Return alpha: 1 up to F_1, 0 from F_2, linear between; own = (tau, F_1, F_2)."""
    return min(max(_share(static_force, own), 0.0), 1.0)


def weight_slopes_core(static_force: float, factor: float, own: tuple[float, ...]) -> tuple[float, float, float]:
    """Return the derivatives of alpha by F_s, F_1 and F_2, each times a factor."""
    share = _share(static_force, own)
    slope = factor / (own[2] - own[1]) * ((share > 0.0) * (share < 1.0))
    return -copysign(1.0, static_force) * slope, slope * share, slope * (1.0 - share)


def _share(static_force: float, own: tuple[float, ...]) -> float:
    return (own[2] - abs(static_force)) / (own[2] - own[1])


def advance_core(lagged: float, piece: Piece, own: tuple[float, ...], valve: Valve) -> float:
    """Solve the first line of Eq 3.25 over a piece."""
    return advance(lagged, piece.static_start, piece.static_end, own[0], piece.step)


@dataclass(frozen=True, slots=True)
class Lpnl2(ShockLaw):
    """F = alpha F_lag + (1 - alpha) F_s with tau dF_lag/dt = F_s - F_lag and alpha = alpha(|F_s|) (Fig 3.8)."""

    time_constant: float  #: tau [s]; 1.3 ms for build 1 (3.3.3).
    lag_full_force: float  #: |F_s| up to which alpha = 1 [N]; 560 lbf for build 1.
    lag_zero_force: float  #: |F_s| from which alpha = 0 [N]; 1000 lbf for build 1. Greater than `lag_full_force`.

    def __post_init__(self) -> None:
        check_time_constant(self.time_constant)
        if not 0.0 <= self.lag_full_force < self.lag_zero_force < float("inf"):
            raise ValueError(
                f"lag_zero_force ({self.lag_zero_force!r} N) must be greater than lag_full_force "
                f"({self.lag_full_force!r} N), and neither may be negative"
            )

    def lag_weight(self, static_force: float) -> float:
        """Return alpha: 1 up to `lag_full_force`, 0 from `lag_zero_force`, linear between."""
        return weight_core(static_force, (self.time_constant, self.lag_full_force, self.lag_zero_force))

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Solve the first line of Eq 3.25 over a piece."""
        return advance(lagged, static_start, static_end, self.time_constant, step)
