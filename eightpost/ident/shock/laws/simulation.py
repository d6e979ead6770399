"""A law over a whole record: the numbers of the scalar law, at the speed of arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.basis import curve_forces
from eightpost.ident.shock.record.lagging import lag
from eightpost.shock import Lpf1, Lpnl2, Polylinear, own_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.shock import Port, ShockLaw
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]


def simulate(law: ShockLaw, series: TimeSeries) -> Array:
    """Return the port force (N,) [N], positive in compression, of a law driven by a record.

    The static force goes linearly between the samples and the lag starts in equilibrium, F_lag = F_s.

    Args:
        law: With its port.
        series: `velocity` [m/s] at the port; `displacement` [m] from the gas spring's reference, 0 where missing.

    Raises:
        MissingChannelError: There is no velocity.
    """
    port = law.port
    velocity = port.motion_ratio * series["velocity"]
    displacement = series["displacement"] if "displacement" in series else np.zeros(len(series))
    static = _scales(port, velocity) * curve_forces(law.curve, velocity)
    valve = _valve_forces(law, static, velocity, series)
    seal = port.seal_friction * np.tanh(velocity / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    return np.asarray(port.motion_ratio * (valve + seal + gas), dtype=np.float64)


def _scales(port: Port, velocity: Array) -> Array:
    return np.where(velocity > 0.0, port.compression_scale, port.rebound_scale)


def _valve_forces(law: ShockLaw, static: Array, velocity: Array, series: TimeSeries) -> Array:
    """Return alpha F_lag + (1 - alpha) F_s (N,) [N] of a static force (N,) [N] over damper velocity (N,) [m/s]."""
    if isinstance(law, Polylinear) or len(series) < 2:
        return static
    if not isinstance(law, Lpf1 | Lpnl2):
        return _stepped(law, velocity, np.diff(series.time))
    if series.is_uniform:
        lagged = lag(static, law.time_constant, 1.0 / series.sample_rate)
    else:
        lagged = _advanced(law, static, series.time)
    weight = _weights(law, static)
    return weight * lagged + (1.0 - weight) * static


def _weights(law: Lpf1 | Lpnl2, static: Array) -> Array | float:
    """Return alpha (N,) [1]."""
    if isinstance(law, Lpf1):
        return 1.0
    share = (law.lag_zero_force - np.abs(static)) / (law.lag_zero_force - law.lag_full_force)
    return np.clip(share, 0.0, 1.0)


def _advanced(law: Lpf1 | Lpnl2, static: Array, time: Array) -> Array:
    """Return F_lag (N,) [N] by the scalar law, step by step over an uneven time axis."""
    lagged = [float(static[0])]
    for start, end, step in zip(static[:-1].tolist(), static[1:].tolist(), np.diff(time).tolist(), strict=True):
        lagged.append(law.advance_lag(lagged[-1], start, end, step))
    return np.array(lagged)


def _stepped(law: ShockLaw, velocity: Array, step: Array) -> Array:
    """Return the valve force (N,) [N] of any law by its own functions, compiled."""
    from eightpost.ident.shock.laws.compiled import stepped_force  # noqa: PLC0415 - the compiler takes a second to load

    own = tuple(getattr(law, name) for name in own_parameters(type(law)))
    return stepped_force(type(law), law.valve._replace(curve=law.curve.numbers()), own, velocity, step)
