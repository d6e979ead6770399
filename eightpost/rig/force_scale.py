"""Lag of the force behind the velocity, for the screen."""

from __future__ import annotations

from eightpost.rig.lag import lag_between
from eightpost.rig.late_force import delay_statement
from eightpost.signals.timeseries import TimeSeries


def lag_statement(series: TimeSeries) -> str:
    """Return the lag of force behind velocity, and how much of it the instruments can cause."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    delay = lag_between(even["force"], even["velocity"], even.sample_rate)
    follows = "follows" if delay >= 0.0 else "leads"
    return f"force {follows} velocity by {1e3 * abs(delay):.3g} ms; {delay_statement(series)}; a fitted lag includes it"
