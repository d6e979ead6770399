"""Change of the temperature within a dynamometer record."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries

#: Temperature change [K] that gives a note.
DRIFT = 5.0


def warming_note(series: TimeSeries) -> str | None:
    """Return a note if the temperature changes; None if it is constant or unknown."""
    if "temperature" not in series:
        return None
    drift = temperature_drift(series)
    if abs(drift) <= DRIFT:
        return None
    return (
        f"temperature: it changes by {drift:+.1f} K over the record, and so does the damping; fit parts of the record "
        "separately, and compare them"
    )


def temperature_drift(series: TimeSeries) -> float:
    """Return the change of temperature [K] over a record, from the mean of its first tenth to that of its last."""
    values = series["temperature"]
    tenth = max(1, values.size // 10)
    return float(values[-tenth:].mean() - values[:tenth].mean())
