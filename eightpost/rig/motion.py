"""Delay of a channel behind others that it is a linear combination of, by cross-correlation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline
from scipy.special import stdtrit

from eightpost.array_types import Array
from eightpost.rig.faults import Fault, fault
from eightpost.signals.filters import lowpass, velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries

# ==== Delay of a channel behind others that it is a linear combination of, by cross-correlation ======================


#: Longest delay that is searched for [s].
LONGEST_DELAY = 0.5

#: Share of the highest correlation, squared, from which another peak counts as equally high.
EQUAL_PEAKS = 0.95

#: Distance from the peak of a correlation at which its decrease is measured [s].
_FALL = 0.025


class Delay(NamedTuple):
    """Delay at the peak of a correlation; zero without correlation if a signal is constant."""

    seconds: float  #: Delay [s]; positive if the values are late.
    correlation: float  #: Multiple correlation at that delay [1].
    spread: float  #: Standard deviation of the delay [s]; it is large for slow motions, whose peak is flat.


def delay_of(values: Array, references: Array, rate: float, *, band: float, longest: float = LONGEST_DELAY) -> Delay:
    """Return the delay of values v (N,) behind references (N,) or (C, N), of which the best combination is taken.

    It maximises the multiple correlation of v(t + delay) with the references, up to `longest` to either side; between
    samples a parabola is interpolated. The signals contain frequencies up to `band` [Hz].
    """
    reach = max(1, min(values.size - 2, round(longest * rate)))
    edge = min(reach, values.size // 4)  # the references end where all values of usual delays are known
    used = np.zeros(values.size)
    used[edge : values.size - edge] = 1.0
    v, refs, count = values - values.mean(), np.atleast_2d(references), used.sum()
    refs = (refs - (refs @ used / count)[:, None]) * used
    sums, squares = _products(v, used, reach), _products(v * v, used, reach)
    energy = squares - sums**2 / count
    scale = np.linalg.norm(refs, axis=1)
    if not energy[reach] > 0.0 or not scale.all():
        return Delay(0.0, 0.0, 0.0)
    refs = refs / scale[:, None]
    products = _products(v, refs, reach)
    fits = np.linalg.lstsq(refs @ refs.T, products, rcond=1e-10)[0]
    explained = np.einsum("cl,cl->l", products, fits) / np.maximum(energy, 0.5 * energy[reach])
    best = _nearest_peak(explained, reach)
    correlation = float(np.sqrt(np.clip(explained[best], 0.0, 1.0)))
    # The noise of a signal that is differentiated twice is in the last third of the band.
    independent = 2.0 / 3.0 * min(band, 0.4 * rate) * count / rate
    spread = _spread(explained, best, max(1, round(_FALL * rate)), independent) / rate
    return Delay((best - reach + _vertex(explained, best)) / rate, correlation, spread)


def _products(v: Array, refs: Array, reach: int) -> Array:
    """Return sum_t v(t + l) r(t) for l from -reach to reach (..., 2 reach + 1), of references (..., N)."""
    size = next_fast_len(v.size + reach + 1, real=True)
    correlation = irfft(rfft(v, size) * rfft(refs, size).conj(), size)
    return np.concatenate((correlation[..., -reach:], correlation[..., : reach + 1]), axis=-1)


def _nearest_peak(explained: Array, reach: int) -> int:
    """Return the index of the peak closest to zero lag, at `reach`, among those that are as high as the highest one.

    Steady sines have such peaks at multiples of half a period, because the factor of the reference may be negative. A
    peak is the highest sample of a span in which all are that high: noise causes ripples on it.
    """
    high = np.concatenate([[0], explained >= EQUAL_PEAKS * explained.max(), [0]]).astype(np.int8)
    starts, stops = np.flatnonzero(np.diff(high) == 1), np.flatnonzero(np.diff(high) == -1)
    peaks = np.array([a + int(np.argmax(explained[a:b])) for a, b in zip(starts, stops, strict=True)])
    return int(peaks[np.argmin(np.abs(peaks - reach))])


def _vertex(heights: Array, top: int) -> float:
    """Return the position of a parabola's vertex relative to sample `top`, from -0.5 to 0.5; 0 at the ends."""
    if not 0 < top < heights.size - 1:
        return 0.0
    before, at, after = heights[top - 1 : top + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _spread(explained: Array, top: int, reach: int, independent: float) -> float:
    """Return the standard deviation of a peak's position in samples.

    The fraction that is explained decreases from its peak E by E (w l)^2, where w is the RMS frequency of the motion.
    Noise moves the peak by sqrt((1 - E) / (n E)) / w, where n is the number of independent samples. The decrease is
    measured `reach` samples to either side, because closer to the peak it contains ripples of the noise.
    """
    at, last = float(explained[top]), explained.size - 1
    fall = at - 0.5 * float(explained[max(0, top - reach)] + explained[min(last, top + reach)])
    return reach * float(np.sqrt(max(0.0, 1.0 - at) / (independent * fall))) if fall > 0.0 else np.inf


# ==== Path, turning points of half cycles, and where a steady sine ends ==============================================

ALIKE = 0.1  #: Half cycles are alike if stroke and duration are within this share of their medians.
STEADY = 0.6  #: Minimum share of half cycles that are alike in a steady sine.
FEWEST = 6  #: Minimum number of half cycles of a steady sine.
FEWEST_OTHER = 3  #: Minimum number of half cycles of another steady sine that follows.
SMALLEST = 0.02  #: Minimum stroke of a half cycle, as a share of the stroke of the record; smaller motions are noise.
#: The motion runs down if its RMS velocity after the last steady half cycle is below this share of that before.
SLOWED = 0.7


Item = TypeVar("Item")


def grouped(items: Iterable[Item], belongs: Callable[[Item, list[Item]], bool]) -> list[list[Item]]:
    """Return successive items in groups; the first item that does not belong to a group begins the next one."""
    groups: list[list[Item]] = []
    for item in items:
        if groups and belongs(item, groups[-1]):
            groups[-1].append(item)
        else:
            groups.append([item])
    return groups


def displacement_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m]; if it was not measured, the integral of the velocity minus its mean."""
    if "displacement" in series:
        return series["displacement"]
    from scipy.integrate import cumulative_trapezoid  # noqa: PLC0415 -- slow to load, and most records need no integral

    velocity = series["velocity"]
    return np.asarray(cumulative_trapezoid(velocity - velocity.mean(), series.time, initial=0))


def path_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m], low-passed at a tenth of the sample rate or 50 Hz."""
    rate = series.sample_rate
    return lowpass(displacement_of(series), rate, min(50.0, 0.1 * rate), order=2)


def turning_points(path: Array, *, threshold: float) -> list[int]:
    """Return the samples of alternating maxima and minima of a path (N,) that are more than `threshold` apart."""
    extrema = np.flatnonzero(np.diff(np.sign(np.diff(path))) != 0.0) + 1
    turns: list[int] = []
    for i in map(int, extrema):
        if not turns:
            turns.append(i)
        elif len(turns) > 1 and (path[i] - path[turns[-1]]) * (path[turns[-1]] - path[turns[-2]]) >= 0.0:
            turns[-1] = i
        elif abs(path[i] - path[turns[-1]]) > threshold:
            turns.append(i)
    return turns


def run_down(time: Array, path: Array, velocity: Array) -> float | None:
    """Return the time [s] from which a steady sine runs down until the end of a record; None if it does not.

    The path (N,) [m] must have no noise with a stroke of 2 %.
    """
    turns = np.array(turning_points(path, threshold=SMALLEST * float(np.ptp(path))), dtype=np.intp)
    if turns.size < FEWEST + 1:
        return None
    stroke, duration = np.abs(np.diff(path[turns])), np.diff(time[turns])
    alike = _is_usual(stroke) & _is_usual(duration)
    if np.count_nonzero(alike) < max(FEWEST, STEADY * alike.size):
        return None
    last = int(np.flatnonzero(alike)[-1]) + 1
    end = int(turns[last])
    rest = velocity[end:]
    if time[-1] - time[end] < 0.9 * float(np.median(duration)):
        return None
    if _is_steady(stroke[last:], duration[last:]):
        return None
    slowed = float(np.sqrt(np.mean(rest**2))) < SLOWED * float(np.sqrt(np.mean(velocity[:end] ** 2)))
    return float(time[end]) if slowed else None


def _is_steady(stroke: Array, duration: Array) -> bool:
    """Return whether half cycles (K,) are another steady sine, apart from the transition to it."""
    if stroke.size < FEWEST_OTHER:
        return False
    alike = _is_usual(stroke) & _is_usual(duration)
    return bool(np.count_nonzero(alike) >= max(FEWEST_OTHER, STEADY * alike.size))


def _is_usual(values: Array) -> NDArray[np.bool_]:
    """Return whether each value (K,) is within a share of the median."""
    return np.asarray(np.abs(values / np.median(values) - 1.0) <= ALIKE)


# ==== Delay of the force behind the velocity ==========================================================================
# The delay T is that with which a small model of the shock leaves the smallest residual,
#
#     min over T, f, K, F0 of  sum (F(t + T) - f(v) - K x - F0)^2,   K >= 0
#
# with f linear between knots that are dense at low speed, so that it includes friction. Gas stiffness K and friction
# delay the force of a sine too, and are therefore in the model and not in T. T is the sum of what the shock itself does
# (compressibility, hysteresis) and of what the instruments do (filters, channels sampled one after the other); a record
# alone does not separate them.
#
# The 95 % interval contains the delays whose residual is not significantly larger. The residual is mostly misfit of the
# model, which recurs with each cycle: its independent values are counted in its spectrum, not in its samples. Where the
# interval is wide or reaches the end of the search (a single sine whose curve is a straight line: a spring does the
# same), the delay is unknown.

#: Delays that are searched: from the first to the second [s], and up to this share of the period of the motion.
EARLIEST, LATEST, SHARE = -0.04, 0.06, 0.25
#: Widest half of an interval that is stated, and the part of it that every interval has [s].
WIDEST, TIMING = 0.01, 2e-4
#: Most independent values of a residual: the model's misfit at a speed recurs, however long the record is.
MOST_INDEPENDENT = 20.0
#: Largest delay that a shock itself has, and smallest lead that is reported [s], at least this share of a sample: a
#: velocity that is a difference of positions is half a sample late.
LAG, LEAD, SAMPLES = 0.01, 5e-4, 0.6
#: Rate at which channels are compared, their cut-off frequency [Hz], the ends that are left out [s], where filters
#: ring, and fewest samples.
_RATE, _CUTOFF, _END, _FEWEST = 500.0, 50.0, 0.1, 200
_PARTS, _PART = 16, 4.0  #: Parts of a long record that are used, and their length [s].
_KNOTS, _DENSE = 8, 1.8  #: Knots of each stroke, and exponent of their spacing.
#: Smallest share of the variance that a residual has, share that keeps columns apart, resolution of a delay [s], and
#: fewest delays that are tried.
_LEAST, _RIDGE, _FINE, _FEWEST_STEPS = 1e-8, 1e-9, 2e-5, 5


class _ForceLag(NamedTuple):
    """Delay of the force behind the velocity; negative if it leads."""

    seconds: float  #: Delay [s].
    low: float  #: Lower end of its 95 % interval [s].
    high: float  #: Upper end [s].
    stiffness: float = 0.0  #: Stiffness K of the model [N/m].

    def __str__(self) -> str:
        """Return the delay and its interval in milliseconds."""
        return f"{1e3 * self.seconds:.3g} ms ({1e3 * self.low:.3g} to {1e3 * self.high:.3g} ms)"


def force_lag(series: TimeSeries) -> _ForceLag | None:
    """Return the delay of the force of a record behind its velocity; None if it is unknown."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rows = _compared(np.stack([even["velocity"], displacement_of(even), even["force"]]), even.sample_rate)
    if not rows.std(axis=1).all():
        return None
    velocity, path, force = rows
    period = 2.0 * np.pi * float(path.std() / velocity.std())
    return _lag(force, velocity, _curve(velocity), path, period)


# ---- The estimate ---------------------------------------------------------------------------------------------------


def _compared(rows: Array, rate: float) -> Array:
    """Return channels (C, N) without high frequencies at the rate of the comparison."""
    low = lowpass(rows, rate, min(_CUTOFF, 0.3 * rate))
    time = np.arange(rows.shape[1]) / rate
    grid = np.arange(0.0, time[-1], 1.0 / _RATE)
    return np.asarray(CubicSpline(time, low, axis=1)(grid))


def _curve(velocity: Array) -> Array:
    """Return the columns (N, 2 K) of a curve that is linear between knots and zero at zero velocity."""
    sides = []
    for side in (velocity, -velocity):
        speed = np.maximum(side, 0.0)
        knots = float(speed.max()) * np.linspace(0.0, 1.0, _KNOTS + 1) ** _DENSE
        sides += [np.clip(speed - low, 0.0, high - low) for low, high in pairwise(knots)]
    return np.stack([column for column in sides if column.any()], axis=1)


def _lag(values: Array, reference: Array, columns: Array, spring: Array, period: float) -> _ForceLag | None:
    """Return the delay of values (N,) that makes columns (N, C) and a spring (N,) explain most of them."""
    reach = SHARE * period
    steps = np.arange(int(max(EARLIEST, -reach) * _RATE), int(min(LATEST, reach) * _RATE) + 1)
    used = _used(values.size, int(steps[-1]))
    if steps.size < _FEWEST_STEPS or used.size < _FEWEST:
        return None
    shifted, lags = _about(values[used + steps[:, None]].T), steps / _RATE
    fine = np.arange(lags[0], lags[-1], _FINE)
    profile, _ = _residual(_about(columns[used]), shifted, lags, fine)
    model = _about(np.column_stack([columns, spring])[used])
    other, weight = _residual(model, shifted, lags, fine)
    profile, stiffness = np.where(weight > 0.0, other, profile), np.maximum(weight, 0.0)
    # At half a period the channels oppose each other: a curve that falls would explain them.
    follows = CubicSpline(lags, _about(reference[used]) @ shifted)(fine) > 0.0
    profile = np.where(follows, profile, np.inf)
    best = int(np.argmin(profile))
    nearest = shifted[:, int(np.argmin(np.abs(lags - fine[best])))]
    # Number of independent values of the residual: of equally strong lines with the same spread.
    power = np.abs(np.fft.rfft(nearest - model @ _weights(model, model.T @ nearest))) ** 2
    independent = float(min(power.sum() ** 2 / np.sum(power**2), MOST_INDEPENDENT))
    found = _interval(fine, profile, best, independent)
    return None if found is None else _ForceLag(float(fine[best]), *found, float(stiffness[best]))


def _about(rows: Array) -> Array:
    """Return values (M, ...) about their mean, which stands for a constant of the model."""
    return np.asarray(rows - rows.mean(axis=0))


def _used(count: int, reach: int) -> NDArray[np.intp]:
    """Return the samples that are compared: all that have a value at every delay, or some parts of a long record."""
    edge = reach + round(_END * _RATE)
    inside, part = count - 2 * edge, round(_PART * _RATE)
    if inside <= _PARTS * part:
        return edge + np.arange(max(inside, 0))
    starts = edge + np.linspace(0, inside - part, _PARTS).astype(np.intp)
    return np.asarray((starts[:, None] + np.arange(part)).ravel())


def _residual(columns: Array, shifted: Array, lags: Array, fine: Array) -> tuple[Array, Array]:
    """Return the share that columns (M, C) do not explain at finer delays (F,), and the weight of the last column."""
    sums = columns.T @ shifted
    weights = _weights(columns, sums)
    share = 1.0 - np.sum(sums * weights, axis=0) / np.sum(shifted**2, axis=0)
    profile, last = CubicSpline(lags, np.stack([share, weights[-1]]), axis=1)(fine)
    return np.maximum(profile, _LEAST), np.asarray(last)


def _weights(columns: Array, sums: Array) -> Array:
    """Return the weights (C, ...) of columns (M, C) from their products (C, ...) with values."""
    product = columns.T @ columns
    size = np.sqrt(np.maximum(np.diag(product), np.finfo(float).tiny))
    scaled = product / np.outer(size, size) + _RIDGE * np.eye(size.size)
    return np.asarray((np.linalg.solve(scaled, (sums.T / size).T).T / size).T)


def _interval(lags: Array, profile: Array, best: int, independent: float) -> tuple[float, float] | None:
    """Return the 95 % interval of the delay with the smallest residual; None if it is wide or ends with the search."""
    limit = profile[best] * (1.0 + float(stdtrit(independent, 0.975)) ** 2 / independent)
    likely = np.flatnonzero(profile <= limit)
    first, last = int(likely[0]), int(likely[-1])
    if first == 0 or last == lags.size - 1 or lags[last] - lags[first] > 2.0 * WIDEST:
        return None
    early, late = (float(np.hypot(lags[end] - lags[best], TIMING)) for end in (first, last))
    return float(lags[best]) - early, float(lags[best]) + late


# ---- What is stated --------------------------------------------------------------------------------------------------


def lag_statement(series: TimeSeries) -> str:
    """Return the delay of the force in a sentence."""
    lag = force_lag(series)
    if lag is None:
        return "lag of the force behind velocity: unknown; this motion does not separate it from gas and friction"
    return f"lag of the force behind velocity: {lag}, of shock and instruments together; a fitted lag includes it"


def lag_faults(series: TimeSeries) -> Iterator[Fault]:
    """Yield a fault if the force is certainly later, or earlier, than a shock makes it."""
    lag = force_lag(series)
    if lag is None:
        return
    if lag.low > LAG:
        yield fault("late force", "the force is later than a shock makes it", f"by {lag}")
    elif lag.high < -max(LEAD, SAMPLES / series.sample_rate):
        lead = _ForceLag(-lag.seconds, -lag.high, -lag.low)
        yield fault("early force", "the force is earlier than a shock makes it", f"by {lead}")


# ==== Whether the measured velocity is the slope of the displacement: units, gain, lag, mean, samples ================

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
RATIO_TOLERANCE = 0.08  #: Relative tolerance of such a ratio.
#: Maximum lag of velocity behind the slope of displacement [samples], and its standard deviations that are allowed.
LAG_SAMPLES, DEVIATIONS = 1.5, 2.0
SLOPE_SHARE = 0.05  #: Maximum relative difference in size between measured velocity and the slope of displacement, ...
OFFSET_SHARE = 0.02  #: ... maximum difference of their means as a share of the standard deviation of velocity, ...
APART = 0.2  #: ... and maximum difference at any sample as a share of the range of velocity.
TRAVEL = 0.6  #: Largest travel of a shock [m], by which the mean of a velocity without displacement is judged.


def motion_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    """Yield a fault if the measured velocity is not the slope of the displacement."""
    if "velocity" not in measured:
        return
    if "displacement" in series and (cause := cause_of(ratio := slope_ratio(series))):
        figure = f"the slope of displacement is {ratio:.4g} times the velocity: {cause}"
        yield fault("contradictory units", "the units of the channels contradict each other", figure)  # fmt: skip
    elif figure := _disagreement(series) if "displacement" in series else _travel(series):
        yield fault("velocity and displacement disagree", "velocity and displacement disagree", figure)


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
    lag = delay_of(velocity, slope, rate, band=_CUTOFF)
    if abs(lag.seconds) - DEVIATIONS * lag.spread > LAG_SAMPLES / rate:
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
    from scipy.integrate import cumulative_trapezoid  # noqa: PLC0415 -- slow to load, and most records need no integral

    time = series.time
    path = cumulative_trapezoid(series["velocity"], time, initial=0)
    net = float(path[-1])
    stroke = float(np.ptp(path - net * (time - time[0]) / series.duration))
    if abs(net) <= max(2.0 * stroke, TRAVEL) and abs(net) <= 5.0 * stroke:
        return ""
    return f"a mean velocity of {net / series.duration:.3g} m/s would move the shock by {net:.3g} m"
