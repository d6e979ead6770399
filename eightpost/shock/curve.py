"""The static curve F_s = f(v): what a shock would give if it had no lag (Eq 3.23, "Polylinear" of 3.1.5).

Standard library only: the FMU ships this very file.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

#: Orders of the dissertation's fit (3.3.1).
INNER_ORDER = 15
OUTER_ORDER = 3


def polynomial(coefficients: tuple[float, ...], s: float) -> float:
    """Return c_0 + c_1 s + c_2 s^2 + ... by Horner's rule."""
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * s + coefficient
    return value


@dataclass(frozen=True, slots=True)
class StaticCurve:
    """A high-order polynomial at low speed, a cubic on each side beyond, straight lines outside the fitted range.

        inner(v)       = sum_k inner[k-1] (v / v_t)^k              k = 1 .. 15, so that f(0) = 0
        compression(v) = sum_k compression[k] ((v - v_t) / v_t)^k   k = 0 .. 3
        rebound(v)     = sum_k rebound[k] ((-v - v_t) / v_t)^k      k = 0 .. 3

    The pieces are blended linearly over `transition_width` about v_t = `transition_speed`. Beyond the fitted speeds
    the curve goes on with the given slopes: a polynomial outside its data is not to be trusted (Fig 3.5a).

    Args:
        inner: 15 coefficients [N].
        compression: 4 coefficients [N].
        rebound: 4 coefficients [N]; the force is negative in rebound.
        transition_speed: v_t [m/s]; 15 in/s in 3.3.1.
        transition_width: [m/s]; 0.5 in/s in 3.3.1. Less than twice `transition_speed`.
        compression_speed: Highest fitted speed in compression [m/s], positive.
        rebound_speed: Highest fitted speed in rebound [m/s], positive.
        compression_slope: Slope beyond `compression_speed` [N.s/m], not negative.
        rebound_slope: Slope beyond `rebound_speed` [N.s/m], not negative.

    Raises:
        ValueError: A value is not finite or outside its range; the message names it.
    """

    inner: tuple[float, ...]
    compression: tuple[float, ...]
    rebound: tuple[float, ...]
    transition_speed: float
    transition_width: float
    compression_speed: float
    rebound_speed: float
    compression_slope: float
    rebound_slope: float

    def __post_init__(self) -> None:
        self._check_coefficients("inner", INNER_ORDER)
        self._check_coefficients("compression", OUTER_ORDER + 1)
        self._check_coefficients("rebound", OUTER_ORDER + 1)
        for name in ("transition_speed", "transition_width", "compression_speed", "rebound_speed"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"curve: {name} must be positive, not {getattr(self, name)!r}")
        if self.transition_width >= 2.0 * self.transition_speed:
            raise ValueError(
                f"curve: transition_width {self.transition_width!r} must be less than twice transition_speed "
                f"{self.transition_speed!r}: the curve must pass through zero at zero velocity"
            )
        for name in ("compression_slope", "rebound_slope"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"curve: {name} must not be negative, not {getattr(self, name)!r}")

    def _check_coefficients(self, name: str, count: int) -> None:
        values = getattr(self, name)
        if len(values) != count or not all(isfinite(value) for value in values):
            raise ValueError(f"curve: {name} takes {count} finite coefficients, not {values!r}")

    def force(self, velocity: float) -> float:
        """Return F_s [N] at a damper velocity [m/s], positive in compression (Eq 3.23)."""
        if velocity > self.compression_speed:
            return self._fitted(self.compression_speed) + self.compression_slope * (velocity - self.compression_speed)
        if velocity < -self.rebound_speed:
            return self._fitted(-self.rebound_speed) + self.rebound_slope * (velocity + self.rebound_speed)
        return self._fitted(velocity)

    def is_beyond_fit(self, velocity: float) -> bool:
        """Say whether a damper velocity [m/s] lies outside the fitted range."""
        return velocity > self.compression_speed or velocity < -self.rebound_speed

    def _fitted(self, velocity: float) -> float:
        outer_share = self._outer_share(abs(velocity))
        inner = outer = 0.0
        if outer_share < 1.0:
            s = velocity / self.transition_speed
            inner = s * polynomial(self.inner, s)
        if outer_share > 0.0:
            coefficients = self.compression if velocity > 0.0 else self.rebound
            outer = polynomial(coefficients, (abs(velocity) - self.transition_speed) / self.transition_speed)
        return (1.0 - outer_share) * inner + outer_share * outer

    def _outer_share(self, speed: float) -> float:
        share = (speed - self.transition_speed) / self.transition_width + 0.5
        return min(max(share, 0.0), 1.0)
