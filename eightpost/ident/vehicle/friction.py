"""Friction that creeps, tanh(v / v_f), in a record; `eightpost.ident.vehicle.port_laws` has friction that sticks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction

#: Rate [Hz] at which the law is evaluated: harmonics of the tanh far above the records' band would otherwise alias.
_RATE = 1000.0


def direction(velocity: Array, rate: float, width: float) -> Array:
    """Return `tanh(v / v_f)` (N,), evaluated at a higher rate and band-limited to the rate of the record.

    Args:
        velocity: Shock velocity v of a record [m/s] (N,).
        rate: Sample rate of the record [Hz].
        width: Friction velocity v_f [m/s].

    Raises:
        ParameterError: The friction velocity is not above zero.
    """
    if not width > 0.0:
        raise ParameterError(f"the friction velocity is {width!r} m/s; it must be above zero")
    finer = max(1, round(_RATE / rate))
    if finer == 1:
        return np.tanh(velocity / width)
    # Padding avoids lengths with a large prime factor, whose transforms take ten times as long.
    padded = np.zeros(next_fast_len(velocity.size, real=True))
    padded[: velocity.size] = velocity
    fine = resample(padded, padded.size * finer)
    return np.asarray(resample(np.tanh(fine / width), padded.size)[: velocity.size], dtype=np.float64)


def with_friction(series: TimeSeries, friction: Mapping[str, Friction]) -> TimeSeries:
    """Return a record whose shock forces include the friction of their ports.

    Args:
        series: Record with `force` and `velocity` of each port.
        friction: Friction by port: "lf", ...; "" for a quarter car.
    """
    for port, law in friction.items():
        if law.force:
            name, velocity = channel(port, "force"), series[channel(port, "velocity")]
            rubbing = law.force * direction(velocity, series.sample_rate, law.velocity)
            series = series.with_channel(name, "N", series[name] + rubbing)
    return series
