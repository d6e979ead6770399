"""Random shocks: a law, its curve, its port, its own parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.shock import Port, StaticCurve

Random = np.random.Generator
Array = NDArray[np.float64]

LAWS = ("polylinear", "lpf1", "lpnl2")

#: Order of the polynomial that is fitted to a drawn nose.
_NOSE_ORDER = 9
#: Share of shocks whose force falls somewhere.
_FALLING = 0.2


@dataclass(frozen=True)
class DrawnShock:
    """Randomly drawn shock."""

    law: str  #: Name of the law.
    curve: StaticCurve  #: Static curve.
    port: Port  #: Motion ratio, scales, gas spring, seal drag.
    own: Mapping[str, float]  #: Parameters of the law, by name, SI.
    nose_slope: float  #: Slope of the curve at zero [N.s/m].
    falls: bool  #: Whether the force falls somewhere.

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the FMU by name."""
        found = dict(asdict(self.port)) | dict(self.own)
        for name, value in asdict(self.curve).items():
            if isinstance(value, tuple):
                found |= {f"curve.{name}[{k}]": number for k, number in enumerate(value, start=1)}
            else:
                found[f"curve.{name}"] = value
        return found


def log_uniform(random: Random, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between two bounds."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def some(random: Random, share: float, value: float, otherwise: float = 0.0) -> float:
    """Return `value` in a share of the draws, else `otherwise`."""
    return value if random.random() < share else otherwise


def draw_shock(random: Random, law: str) -> DrawnShock:
    """Return a random shock of a law."""
    port = _port(random)
    falls = bool(random.random() < _FALLING)
    curve, nose = draw_curve(random, falls=falls)
    own = {}
    if law != "polylinear":
        own["time_constant"] = log_uniform(random, 1e-4, 1e-2)
    if law == "lpnl2":
        own["lag_full_force"] = log_uniform(random, 50.0, 1500.0)
        own["lag_zero_force"] = own["lag_full_force"] + log_uniform(random, 50.0, 2000.0)
    return DrawnShock(law, curve, port, own, nose, falls)


def _port(random: Random) -> Port:
    return Port(
        motion_ratio=some(random, 0.3, log_uniform(random, 0.6, 1.4), 1.0),
        compression_scale=some(random, 0.4, random.uniform(0.4, 1.8), 1.0),
        rebound_scale=some(random, 0.4, random.uniform(0.4, 1.8), 1.0),
        gas_stiffness=some(random, 0.5, log_uniform(random, 300.0, 2e4)),
        gas_preload=some(random, 0.5, random.uniform(50.0, 1500.0)),
        seal_friction=some(random, 0.5, log_uniform(random, 5.0, 100.0)),
        friction_velocity=log_uniform(random, 1e-3, 2e-2),
    )


def draw_curve(random: Random, *, falls: bool) -> tuple[StaticCurve, float]:
    """Return a digressive curve with a knee on each side, and its slope at zero [N.s/m].

    Args:
        random: Random generator.
        falls: Whether the force falls over a part of one side.
    """
    nose = log_uniform(random, 1e3, 1e5)
    knee_force = log_uniform(random, 100.0, 1500.0)
    speed = float(np.clip(knee_force / nose * random.uniform(1.5, 3.5), 0.003, 0.5))
    width = speed * random.uniform(0.02, 0.6)
    sides = [_Side.draw(random, nose, speed) for _ in range(2)]
    falling = int(random.integers(2)) if falls else -1
    inner = _nose(nose, speed, width, sides)
    starts = sum(inner), -sum(a * (-1.0) ** k for k, a in enumerate(inner, start=1))  # at both transitions
    outer = [
        side.outer(random, speed, start, falls=k == falling)
        for k, (side, start) in enumerate(zip(sides, starts, strict=True))
    ]
    curve = StaticCurve(
        inner=inner,
        compression=outer[0],
        rebound=tuple(-b for b in outer[1]),  # type: ignore[arg-type]
        transition_speed=speed,
        transition_width=width,
        compression_speed=speed + sides[0].span,
        rebound_speed=speed + sides[1].span,
        compression_slope=sides[0].slope * random.uniform(0.5, 1.5),
        rebound_slope=sides[1].slope * random.uniform(0.5, 1.5),
    )
    return curve, nose


@dataclass(frozen=True)
class _Side:
    """Return one side of a curve: f = slope v + height (1 - exp(-v / knee)), v > 0, up to `span` beyond it."""

    slope: float
    height: float
    knee: float
    span: float

    @classmethod
    def draw(cls, random: Random, nose: float, speed: float) -> _Side:
        slope = float(np.clip(nose * random.uniform(0.02, 0.5), 200.0, 6000.0))
        slope = min(slope, 0.7 * nose)
        knee = speed / random.uniform(1.5, 3.5)
        return cls(slope, (nose - slope) * knee, knee, random.uniform(0.3, 1.5))

    def force(self, v: Array) -> Array:
        return self.slope * v + self.height * (1.0 - np.exp(-v / self.knee))

    def outer(self, random: Random, speed: float, start: float, *, falls: bool) -> tuple[float, ...]:
        """Return the coefficients of the cubic that continues from `start` [N] at the transition speed [m/s]."""
        first, last = self.slope, self.slope * random.uniform(0.3, 2.0)
        if falls:
            share = random.uniform(0.1, 0.6)  # share of the span
            first = -2.0 * start * random.uniform(0.1, 0.6) / (share * self.span)
            last = -first * (1.0 - share) / share
        return start, first * speed, 0.5 * (last - first) * speed**2 / self.span, 0.0


def _nose(nose: float, speed: float, width: float, sides: list[_Side]) -> tuple[float, ...]:
    """Return the polynomial closest to both sides below the transition; its slope at zero is `nose`."""
    s = np.linspace(-1.0, 1.0, 401) * (1.0 + 0.5 * width / speed)
    v = np.abs(s) * speed
    wanted = np.where(s > 0.0, sides[0].force(v), -sides[1].force(v)) - nose * speed * s
    powers = np.arange(2, _NOSE_ORDER + 1)
    found = np.linalg.lstsq(s[:, None] ** powers, wanted, rcond=None)[0]
    return (nose * speed, *found.tolist(), *[0.0] * (15 - _NOSE_ORDER))
