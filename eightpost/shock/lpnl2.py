"""LPNL2: lag at low force, none at high force (Eq 3.25). Standard library only: the FMU ships this very file."""

from __future__ import annotations

from dataclasses import dataclass

from .lag import advance
from .law import ShockLaw, check_time_constant


@dataclass(frozen=True, slots=True)
class Lpnl2(ShockLaw):
    """F = alpha F_lag + (1 - alpha) F_s with tau dF_lag/dt = F_s - F_lag and alpha = alpha(|F_s|) (Fig 3.8).

    Args:
        time_constant: tau [s]; 1.3 ms for build 1 (3.3.3).
        lag_full_force: |F_s| up to which alpha = 1 [N]; 560 lbf for build 1.
        lag_zero_force: |F_s| from which alpha = 0 [N]; 1000 lbf for build 1. Greater than `lag_full_force`.
    """

    time_constant: float
    lag_full_force: float
    lag_zero_force: float

    def __post_init__(self) -> None:
        check_time_constant(self.time_constant)
        if not 0.0 <= self.lag_full_force < self.lag_zero_force < float("inf"):
            raise ValueError(
                f"lag_zero_force ({self.lag_zero_force!r} N) must be greater than lag_full_force "
                f"({self.lag_full_force!r} N), and neither negative"
            )

    def lag_weight(self, static_force: float) -> float:
        """alpha = 1 up to `lag_full_force`, 0 from `lag_zero_force`, linear between."""
        share = (self.lag_zero_force - abs(static_force)) / (self.lag_zero_force - self.lag_full_force)
        return min(max(share, 0.0), 1.0)

    def advance_lag(self, lagged: float, static_start: float, static_end: float, step: float) -> float:
        """Eq 3.25, first line."""
        return advance(lagged, static_start, static_end, self.time_constant, step)
