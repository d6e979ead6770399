"""A shock as a few shape numbers: a curve that nobody has built yet, for the search of a curve to aim at (chapter 8).

Each side of the static curve has five numbers; its slope is a mean of them with positive weights, so the force always
rises with velocity and the shock is passive:

    c(v) = b c_bleed + (1 - b) [l c_low + (1 - l) (c_high + a v)]
    b = exp(-(4 v / v_k)^2),   l = 1 / (1 + (v / v_k)^2),   v = |velocity|

c_bleed is the slope at rest, where an open bleed lets the oil pass; c_low applies from a quarter of the knee speed v_k
to the knee; beyond it the valve is open, with the slope c_high and its growth a, which ports cause at high speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite

import numpy as np
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.lpnl2 import Lpnl2
from eightpost.shock.port import Port

#: Sides of a curve, in the order of the numbers of a shape.
SIDES = ("compression", "rebound")

#: Highest speed of the knots of a shape's curve [m/s]: that of the shipped bank's dynamometer tests.
REACH = 1.3

#: Speed up to which the bleed acts, as a share of the knee speed.
BLEED_SHARE = 0.25

#: Speeds of the knots of one side, as shares of the highest [1]: closer at low speed, where the slope changes most.
SHARES = np.linspace(0.0, 1.0, KNOTS // 2 + 1) ** 2.2


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a curve, compression or rebound; all numbers are positive, `rise` may be 0.

    Raises:
        ParameterError: A number is not finite or not positive; the message names it.
    """

    bleed: float  #: Slope at rest [N.s/m].
    low: float  #: Slope between bleed and knee [N.s/m].
    knee: float  #: Speed of the knee [m/s].
    high: float  #: Slope beyond the knee, extrapolated to zero speed [N.s/m].
    rise: float  #: Growth of that slope with speed [N.s2/m2].

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (isfinite(value) and (value > 0.0 or (one.name == "rise" and value == 0.0))):
                raise ParameterError(f"shape: {one.name} must be positive, not {value!r}")

    def slope(self, speed: Array) -> Array:
        """Return the slope (N,) [N.s/m] at speeds (N,) [m/s]."""
        return np.asarray(slope_weights(speed, self.knee) @ np.array([self.bleed, self.low, self.high, self.rise]))


#: SI unit of each number of a side.
UNITS = {"bleed": "N.s/m", "low": "N.s/m", "knee": "m/s", "high": "N.s/m", "rise": "N.s2/m2"}


@dataclass(frozen=True, slots=True)
class Shape:
    """A shock as shape numbers: both sides of the curve, lag and gas.

    Raises:
        ParameterError: A number is out of range; the message names it.
    """

    compression: Side  #: Compression side.
    rebound: Side  #: Rebound side.
    lag: float = 1e-3  #: Time constant of the lag [s] (LPNL2).
    lag_force: float = 3000.0  #: Force from which there is no lag [N] (LPNL2).
    gas: float = 0.0  #: Gas force at zero displacement [N]; 0 if the vehicle's static state contains it.

    def __post_init__(self) -> None:
        for name in ("lag", "lag_force"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ParameterError(f"shape: {name} must be positive, not {getattr(self, name)!r}")
        if self.lag_force <= LAG_FULL_FORCE:
            raise ParameterError(f"shape: lag_force must be above {LAG_FULL_FORCE:.4g} N, not {self.lag_force!r} N")
        if not isfinite(self.gas):
            raise ParameterError(f"shape: gas must be finite, not {self.gas!r}")

    def curve(self, reach: float = REACH) -> StaticCurve:
        """Return the curve through knots up to a speed [m/s], between which the slope is linear."""
        speed = reach * SHARES
        slopes = {name: getattr(self, name).slope(speed) for name in SIDES}
        at_rest = 0.5 * (self.compression.bleed + self.rebound.bleed)  # one slope at rest, so that there is no corner
        for slope in slopes.values():
            slope[0] = at_rest
        forces = {name: cumulative_trapezoid(slope, speed, initial=0) for name, slope in slopes.items()}
        return StaticCurve.through_knots(
            joined(-speed, speed),
            joined(-forces["rebound"], forces["compression"]),
            joined(slopes["rebound"], slopes["compression"]),
        )

    def law(self, reach: float = REACH) -> Lpnl2:
        """Return the shape as a law with lag and gas force."""
        return Lpnl2(self.curve(reach), self.lag, LAG_FULL_FORCE, self.lag_force, port=Port(gas_preload=self.gas))

    def parameters(self) -> dict[str, float]:
        """Return the parameters by which an FMU of a shape becomes this one; the knots' velocities are the same."""
        found = curve_parameters(self.curve(), ("knot_force", "knot_slope"))
        return found | {"time_constant": self.lag, "lag_zero_force": self.lag_force, "gas_preload": self.gas}

    def numbers(self) -> dict[str, float]:
        """Return the numbers by name, such as `rebound.low`."""
        found = {f"{side}.{name}": getattr(getattr(self, side), name) for side in SIDES for name in UNITS}
        return found | {"lag": self.lag, "lag_force": self.lag_force, "gas": self.gas}

    def with_numbers(self, values: Mapping[str, float]) -> Shape:
        """Return the shape with other values of some numbers.

        Raises:
            ParameterError: There is no such number, or a value is out of range.
        """
        if unknown := sorted(set(values) - set(self.numbers())):
            raise ParameterError(f"shape: there is no number {unknown[0]!r}; they are {', '.join(self.numbers())}")
        numbers = self.numbers() | dict(values)
        compression, rebound = (Side(*(numbers[f"{side}.{name}"] for name in UNITS)) for side in SIDES)
        return Shape(compression, rebound, numbers["lag"], numbers["lag_force"], numbers["gas"])


#: Force up to which the lag is complete [N]: the lower bound of 3.3.3, at which the fits of the shipped bank end.
LAG_FULL_FORCE = 44.482216152605


def curve_parameters(
    curve: StaticCurve, arrays: Sequence[str] = ("knot_velocity", "knot_force", "knot_slope")
) -> dict[str, float]:
    """Return a curve through knots as parameters of a shock FMU by name (docs/reference/ports.md)."""
    found = {f"curve.{name}": getattr(curve, name) for name in ("compression_slope", "rebound_slope")}
    if "knot_velocity" in arrays:
        found |= {f"curve.{name}": getattr(curve, name) for name in ("compression_speed", "rebound_speed")}
    for name in arrays:
        found |= {f"curve.{name}[{k}]": value for k, value in enumerate(getattr(curve, name), start=1)}
    return found


def unit_of(number: str) -> str:
    """Return the SI unit of a shape number by its name.

    >>> unit_of("rebound.knee"), unit_of("lag")
    ('m/s', 's')
    """
    return {"lag": "s", "lag_force": "N", "gas": "N"}.get(number) or UNITS[number.partition(".")[2]]


def slope_weights(speed: Array, knee: float) -> Array:
    """Return the weights (N, 4) of bleed, low, high and rise in the slope at speeds (N,) [m/s]."""
    at_rest = np.exp(-((speed / (BLEED_SHARE * knee)) ** 2))
    closed = 1.0 / (1.0 + (speed / knee) ** 2)
    opened = (1.0 - at_rest) * (1.0 - closed)
    return np.stack([at_rest, (1.0 - at_rest) * closed, opened, opened * speed], axis=1)


def joined(rebound: Array, compression: Array) -> tuple[float, ...]:
    """Return both sides (K,) as one ascending sequence; both begin with the same value, that at rest."""
    return (*rebound[:0:-1].tolist(), *compression.tolist())


#: Numbers of the curve: all but lag and gas.
CURVE_NUMBERS = tuple(f"{side}.{name}" for side in SIDES for name in UNITS)

#: Names of all numbers of a shape.
NUMBERS = (*CURVE_NUMBERS, "lag", "lag_force", "gas")


def range_of(shapes: Sequence[Shape], number: str) -> tuple[float, float]:
    """Return the lowest and the highest value of a number among shapes.

    Raises:
        ParameterError: There is no such number, or all shapes have the same value.
    """
    if number not in shapes[0].numbers():
        raise ParameterError(f"shape: there is no number {number!r}; they are {', '.join(shapes[0].numbers())}")
    values = [shape.numbers()[number] for shape in shapes]
    if not min(values) < max(values):
        raise ParameterError(f"shape: {number} is {values[0]:g} {unit_of(number)} in all shocks; state its limits")
    return min(values), max(values)
