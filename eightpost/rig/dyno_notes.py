"""Note on a lag of the force that a shock cannot have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.rig.lag import lag_between
from eightpost.signals.timeseries import TimeSeries

#: Maximum lag [s] of force behind velocity (the shock's own lag, 3.3, and a filter), and maximum lead `LEAD` [s].
LAG, LEAD = 0.010, 0.002
#: Phase [rad] at the mean frequency below which a lag is accepted: a gas spring causes such a phase in a slow test.
PHASE = np.deg2rad(5.0)


def _path(series: TimeSeries) -> Array:
    """Return displacement (N,) [m], or the integral of velocity without its drift."""
    if "displacement" in series:
        return series["displacement"]
    path = cumulative_trapezoid(series["velocity"], series.time, initial=0)
    return np.asarray(path - path[-1] * np.linspace(0.0, 1.0, path.size))


class _LagNote(NamedTuple):
    """Note on a lag or lead of force that a shock cannot have.

    Attributes:
        delay: Delay of force behind velocity [s]; negative if force leads.
        lead: Maximum plausible lead [s].
        allowed: Maximum plausible delay [s].
        note: Text of the note.
    """

    delay: float
    lead: float
    allowed: float
    note: str


def lag_note(series: TimeSeries) -> _LagNote | None:
    """Return a note if the lag between force and velocity is larger than that of a shock."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    delay = lag_between(even["force"], even["velocity"], even.sample_rate)
    frequency = float(even["velocity"].std() / _path(even).std())  # [rad/s]
    lead, allowed = max(LEAD, 1.5 / even.sample_rate), max(LAG, PHASE / frequency)
    if -lead <= delay <= allowed:
        return None
    note = (
        f"force: it {'follows' if delay > 0.0 else 'leads'} velocity by {1e3 * abs(delay):.3g} ms, more than the lag of a shock (under "
        f"{1e3 * LAG:.0f} ms), because of channels sampled at different times, a filter on one of them, or a spring "
        "parallel to the damper; a fitted lag will include it"
    )
    return _LagNote(delay, lead, allowed, note)
