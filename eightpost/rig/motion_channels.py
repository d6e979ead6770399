"""Whether the measured velocity of a record is the slope of its displacement: units, gain, lag, mean, samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.rig.lag import channel_lag
from eightpost.rig.plausibility_rules import CONTRADICTORY_UNITS, DISAGREE
from eightpost.signals.filters import lowpass, velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Ratios of the slope of displacement to velocity that two contradictory units cause, and what causes them.
RATIOS = {
    1e-3: "time is in ms but labelled s, displacement in m labelled mm, or velocity in mm/s labelled m/s",
    1e3: "time is in s but labelled ms, displacement in mm labelled m, or velocity in m/s labelled mm/s",
    25.4: "displacement is in mm but labelled in, or velocity in in/s labelled mm/s",
    1.0 / 25.4: "displacement is in inches but labelled mm, or velocity in mm/s labelled in/s",
    25.4e-3: "velocity is in mm/s but labelled in/s and displacement is in m labelled mm, or m is labelled in",
    0.1: "displacement is in cm but labelled mm, or velocity in mm/s labelled cm/s",
    10.0: "displacement is in mm but labelled cm, or velocity in cm/s labelled mm/s",
    60.0: "time is in min but labelled s",
    1.0 / 60.0: "velocity is per minute but labelled per second",
}
#: Relative tolerance of such a ratio.
RATIO_TOLERANCE = 0.08
#: Maximum lag of velocity behind the slope of displacement [samples].
SAMPLES = 1.5
#: Maximum relative difference in size between measured velocity and the slope of displacement, ...
SLOPE_SHARE = 0.05
#: ... maximum difference of their means as a share of the standard deviation of velocity, ...
OFFSET_SHARE = 0.02
#: ... and maximum difference at any sample as a share of the range of velocity.
APART = 0.2
#: Largest travel of a shock [m], by which the mean of a velocity without displacement is judged.
TRAVEL = 0.6


def motion_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str) -> Iterator[Reason]:
    """Yield a reason if the measured velocity is not the slope of the displacement.

    Args:
        series: Record with `velocity` [m/s] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
    """
    if "velocity" not in measured:
        return
    if "displacement" in series and (cause := cause_of(ratio := slope_ratio(series))):
        figure = f"the slope of displacement is {ratio:.4g} times the velocity: {cause}"
        yield CONTRADICTORY_UNITS.reason("the units of the channels contradict each other", figure=figure,
                                         origin=origin)  # fmt: skip
    elif figure := _disagreement(series) if "displacement" in series else _travel(series):
        yield DISAGREE.reason("velocity and displacement disagree", figure=figure, origin=origin)


def cause_of(ratio: float) -> str | None:
    """Return what causes a ratio of the slope of displacement to velocity; None for a ratio of no two units."""
    causes = (cause for known, cause in RATIOS.items() if abs(ratio / known - 1.0) <= RATIO_TOLERANCE)
    return next(causes, None)


def slopes(series: TimeSeries) -> tuple[Array, Array, float]:
    """Return velocity (N,) and the slope of displacement (N,) [m/s], both low-passed, and their rate [Hz]."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    cutoff = min(50.0, 0.4 * rate)
    return lowpass(even["velocity"], rate, cutoff), velocity_from_displacement(even["displacement"], rate, cutoff), rate


def slope_ratio(series: TimeSeries) -> float:
    """Return the standard deviation of the slope of displacement over that of velocity [1], both without noise."""
    velocity, slope, _ = slopes(series)
    return float(slope.std() / velocity.std())


def _disagreement(series: TimeSeries) -> str:
    """Return a figure if velocity differs from the slope of displacement in time, size, mean or at a sample."""
    velocity, slope, rate = slopes(series)
    lag = channel_lag(velocity, slope, rate)
    if lag is not None and not (lag.low <= SAMPLES / rate and -SAMPLES / rate <= lag.high):
        follows = "follows" if lag.seconds > 0.0 else "leads"
        return f"velocity {follows} the slope of displacement by {1e3 * abs(lag.seconds):.3g} ms"
    ratio = float(slope.std() / velocity.std())
    factor = float(velocity @ velocity / (velocity @ slope))  # noise of the slope does not enter
    if abs(factor - 1.0) > SLOPE_SHARE and abs(ratio - 1.0) > SLOPE_SHARE:
        return f"velocity is {factor:.4g} times the slope of displacement"
    if abs(offset := float((velocity - slope).mean())) > OFFSET_SHARE * velocity.std():
        return f"the mean of velocity is off that of the slope of displacement by {offset:.3g} m/s"
    edge = int(5.0 * rate / min(50.0, 0.4 * rate))  # the filter rings at the ends
    apart = np.abs(velocity - slope)[edge : velocity.size - edge]
    if apart.size and apart.max() > APART * np.ptp(velocity):
        place = series.time[0] + (int(np.argmax(apart)) + edge) / rate
        return f"velocity is {apart.max():.3g} m/s off the slope of displacement at {place:.4g} s"
    return ""


def _travel(series: TimeSeries) -> str:
    """Return a figure if the mean of velocity, in a record without displacement, is too large for a shock's travel."""
    time = series.time
    path = cumulative_trapezoid(series["velocity"], time, initial=0)
    net = float(path[-1])
    stroke = float(np.ptp(path - net * (time - time[0]) / series.duration))
    if abs(net) <= max(2.0 * stroke, TRAVEL) and abs(net) <= 5.0 * stroke:
        return ""
    return f"a mean velocity of {net / series.duration:.3g} m/s would move the shock by {net:.3g} m"
