"""Change of the temperature within a dynamometer record."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


def temperature_drift(series: TimeSeries) -> float:
    """Return the change of temperature [K] over a record, from the mean of its first tenth to that of its last."""
    values = series["temperature"]
    tenth = max(1, values.size // 10)
    return float(values[-tenth:].mean() - values[:tenth].mean())
