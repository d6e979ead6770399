"""Drive files with ramps and holds: the static test and the bump (dissertation 3.2.3)."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d

from eightpost.errors import ParameterError
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Zero position of the dynamometer's commands, near the middle of the travel (3.2.1) [m].
OFFSET = convert(3.0, "in", "m")

_INCH = convert(1.0, "in", "m")


def static_steps(
    *,
    start: float = 2.0 * _INCH - OFFSET,
    step: float = _INCH,
    steps: int = 3,
    speed: float = convert(0.2, "in/s", "m/s"),
    hold: float = 20.0,
    rate: float = 2000.0,
) -> Drivefile:
    """Return the static profile (Fig 3.12): hold, move one step, hold, up and down again.

    Args:
        start: First position relative to the 3 in zero position [m]; default 2 in, which is -1 in.
        step: Height of a step [m]; default 1 in.
        steps: Number of steps up, and the same number down; default 3.
        speed: Speed between positions [m/s]; default 0.2 in/s.
        hold: Duration at each position [s]; default 20.
        rate: Sample rate [Hz].

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ParameterError: A value is not positive.
    """
    _check(step=step, steps=steps, speed=speed, hold=hold, rate=rate)
    climb = [start + step * i for i in range(steps + 1)]
    return _ramps([*climb, *climb[-2::-1]], speed=speed, hold=hold, rounding=0.05, rate=rate)


def bump(
    *,
    height: float = 0.5 * _INCH,
    speed: float = convert(30.0, "in/s", "m/s"),
    hold: float = 1.0,
    rounding: float = 0.004,
    rate: float = 2000.0,
) -> Drivefile:
    """Return the bump (Fig 3.13): hold, one ramp up, hold, one ramp down, hold.

    Args:
        height: Height of the bump [m]; default 0.5 in.
        speed: Speed in the straight part of the ramps [m/s]; default 30 in/s.
        hold: Duration of each hold [s].
        rounding: Time to reach the speed [s], because an actuator cannot start instantly.
        rate: Sample rate [Hz].

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ParameterError: A value is not positive, or the ramp has no straight part.
    """
    _check(height=height, speed=speed, hold=hold, rounding=rounding, rate=rate)
    if 2.0 * rounding > height / speed:
        raise ParameterError(
            f"a ramp of {height:g} m at {speed:g} m/s takes {height / speed:g} s and cannot be rounded over "
            f"{rounding:g} s at each end; lower the speed or the rounding"
        )
    return _ramps([0.0, height, 0.0], speed=speed, hold=hold, rounding=rounding, rate=rate)


def _check(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0.0 and np.isfinite(value)):
            raise ParameterError(f"{name} must be above 0, not {value:g}")


def _ramps(positions: Sequence[float], *, speed: float, hold: float, rounding: float, rate: float) -> Drivefile:
    """Return holds at positions [m] connected by ramps, with corners rounded by two moving averages."""
    corners = [(0.0, positions[0]), (hold, positions[0])]
    for here, there in itertools.pairwise(positions):
        arrival = corners[-1][0] + abs(there - here) / speed
        corners += [(arrival, there), (arrival + hold, there)]
    times, values = np.array(corners).T
    time = np.arange(round(times[-1] * rate) + 1) / rate
    displacement = np.interp(time, times, values)
    # With two averages of half the length, the acceleration is a triangle and the velocity is smooth.
    width = max(round(0.5 * rounding * rate), 1) // 2 * 2 + 1
    for _ in range(2):
        displacement = uniform_filter1d(displacement, width, mode="nearest")
    return Drivefile(TimeSeries.from_channels(time, {"displacement": ("m", displacement)}))
