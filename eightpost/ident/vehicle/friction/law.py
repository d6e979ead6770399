"""Friction at the ports of a car: the law that the vehicle FMU has, and its signal in a record.

    F = F_f tanh(v / v_f)

It adds to the shock's force at the port, so that the force difference which drives the linear car is

    dF = F_shock + F_f tanh(v / v_f) - c v
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.signals import TimeSeries
    from eightpost.vehicle import Friction

Array = NDArray[np.float64]

#: Friction of one newton (N,) from a velocity (N,) [m/s], its rate [Hz] and a width.
Signal = Callable[[Array, float, float], Array]

#: Rate [Hz] at which the law is taken: a tanh has harmonics far beyond the records' band, which would fold back.
_RATE = 1000.0


def direction(velocity: Array, rate: float, width: float) -> Array:
    """Return `tanh(v / v_f)` (N,) of a record's band: taken at a finer rate, then without what the record cannot hold.

    Args:
        velocity: v (N,) [m/s], of a record's shock.
        rate: Of the record [Hz].
        width: v_f [m/s].
    """
    if not width > 0.0:
        raise ParameterError(f"the friction velocity is {width!r} m/s; give one above zero")
    finer = max(1, round(_RATE / rate))
    if finer == 1:
        return np.tanh(velocity / width)
    # A record's own length may have a large prime factor, which makes its transforms ten times as long.
    padded = np.zeros(next_fast_len(velocity.size, real=True))
    padded[: velocity.size] = velocity
    fine = resample(padded, padded.size * finer)
    return np.asarray(resample(np.tanh(fine / width), padded.size)[: velocity.size], dtype=np.float64)


def with_friction(series: TimeSeries, friction: Mapping[str, Friction]) -> TimeSeries:
    """Return a record whose shock forces hold the friction of their ports too.

    Args:
        series: With `force` and `velocity` of each port.
        friction: By port: "lf", ...; "" for a quarter car.
    """
    for port, law in friction.items():
        if law.force:
            name, velocity = channel(port, "force"), series[channel(port, "velocity")]
            rubbed = law.force * direction(velocity, series.sample_rate, law.velocity)
            series = series.with_channel(name, "N", series[name] + rubbed)
    return series


def with_directions(series: TimeSeries, ports: Sequence[str], width: float, signal: Signal = direction) -> TimeSeries:
    """Return a record with the friction of one newton at every port, as the channel `friction_direction`."""
    for port in ports:
        values = signal(series[channel(port, "velocity")], series.sample_rate, width)
        series = series.with_channel(channel(port, "friction_direction"), "1", values)
    return series
