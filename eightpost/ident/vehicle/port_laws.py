"""Friction and springs at the ports in a record: what its shock forces lack to drive a linear car."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction
from eightpost.vehicle.compiled import deflections

# ---- Friction that creeps, tanh(v / v_f) ----------------------------------------------------------------------------

#: Rate [Hz] at which the law is evaluated: harmonics of the tanh far above the records' band would otherwise alias.
_CREEP_RATE = 1000.0


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
    finer = max(1, round(_CREEP_RATE / rate))
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


# ---- Bristles and port springs --------------------------------------------------------------------------------------

#: Rate at which a bristle is simulated [Hz]: it turns over far less than a sample of a record.
_RATE = 2500.0


def bristle_force(velocity: Array, rate: float, law: Bristle) -> Array:
    """Return the force F_s z / z_s [N] (N,) of a bristle, band-limited to the rate of the record.

    The bristle is relaxed at the first sample. It follows the velocity, interpolated to a rate of 2.5 kHz or more, with
    steps that are exact for their mean velocity.

    Args:
        velocity: Port velocity of a record [m/s] (N,).
        rate: Sample rate of the record [Hz].
        law: Parameters of the bristle; with `force=1.0` the result is the force relative to the sliding force.
    """
    finer = max(1, int(np.ceil(_RATE / rate - 1e-9)))
    if finer == 1:
        return np.asarray(law.force_at(deflections(velocity, 1.0 / rate, law)))
    # Padding avoids lengths with a large prime factor, whose transforms take ten times as long.
    padded = np.zeros(next_fast_len(velocity.size, real=True))
    padded[: velocity.size] = velocity
    fine = deflections(resample(padded, padded.size * finer), 1.0 / (rate * finer), law)
    return np.asarray(law.force_at(resample(fine, padded.size)[: velocity.size]), dtype=np.float64)


def with_port_laws(series: TimeSeries, friction: Mapping[str, Friction]) -> TimeSeries:
    """Return a record whose shock forces include friction, bristle and spring of their ports.

    Args:
        series: Record without means, with `force` and `velocity` of each port, and `displacement` of ports with a
            spring.
        friction: Laws by port: "lf", ...; "" for a quarter car.
    """
    series = with_friction(series, friction)
    for port, law in friction.items():
        name = channel(port, "force")
        if law.bristle.force:
            sticking = bristle_force(series[channel(port, "velocity")], series.sample_rate, law.bristle)
            series = series.with_channel(name, "N", series[name] + sticking)
        if law.spring:
            spring = law.spring * series[channel(port, "displacement")] ** 2
            series = series.with_channel(name, "N", series[name] + spring)
    return series
