"""Records of a fit: choice of the segment, filters, thinning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.errors import ParameterError, TooShortError
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.plausibility import SEGMENT
from eightpost.signals import TimeSeries, lowpass

# ---- Choice of the segment of a record that is fitted (3.3) ---------------------------------------------------------

#: Length of the edges that a record's ends disturb, times the cutoff frequency [1]: the slowest pole of the 8th-order
#: Butterworth decays by exp(-2 pi 0.195 f_c t), to 0.06 % here.
FILTER_EDGE = 6.0

#: The dissertation's segment is not used if the shock's speed there stays below this share of its peak speed.
_LIVELY = 0.5


def _choose_segment(
    series: TimeSeries, requested: tuple[float, float] | None, cutoff: float
) -> tuple[tuple[float, float], list[str]]:
    """Return start and stop [s] of the segment, and a sentence if it is not the dissertation's.

    Args:
        series: Record with `velocity`; time starts at 0.
        requested: Requested start and end [s], or None.
        cutoff: Cutoff frequency of the low-pass [Hz]; the filter's edges are left out.

    Raises:
        ParameterError: The requested segment is not in the record.
    """
    edge = FILTER_EDGE / cutoff
    whole = (edge, series.duration - edge)
    if requested is not None:
        return _requested(requested, series.duration, whole)
    if series.duration < SEGMENT[1]:
        return whole, [
            f"{_seconds(whole)} fitted, all but the filter's edges, because the record lasts {series.duration:.4g} s"
        ]
    velocity = np.abs(series["velocity"])
    here = velocity[(series.time >= SEGMENT[0]) & (series.time <= SEGMENT[1])].max()
    if here < _LIVELY * velocity.max():
        why = f"{100.0 * here / velocity.max():.0f} % of the record's peak speed"
        return whole, [f"{_seconds(whole)} fitted, the whole record, because seconds 1 to 10 reach only {why}"]
    return (SEGMENT[0], min(SEGMENT[1], whole[1])), []


def _requested(
    requested: tuple[float, float], duration: float, whole: tuple[float, float]
) -> tuple[tuple[float, float], list[str]]:
    start, stop = requested
    if not 0.0 <= start < stop or stop > duration * (1.0 + 1e-9):
        raise ParameterError(
            f"the segment must lie within the record, 0 to {duration:.4g} s, not from {start:g} to {stop:g} s"
        )
    used = (max(start, whole[0]), min(stop, whole[1]))
    changes = [] if requested == SEGMENT else [f"{_seconds(used)} fitted as requested, instead of 1 to 10 s"]
    return used, changes


def _seconds(segment: tuple[float, float]) -> str:
    return f"seconds {segment[0]:.4g} to {segment[1]:.4g}"


# ---- Preparation of a dynamometer record for the fit ----------------------------------------------------------------

#: Cutoff frequency of the low-pass [Hz] and its maximum as a share of the sampling rate.
CUTOFF, LARGEST_SHARE = 50.0, 0.4

#: Records with a higher rate are thinned after the low-pass, to at least this rate [Hz], the dissertation's own.
WORKING_RATE = 2000.0

#: Minimum number of samples for a fit of 26 parameters.
FEWEST = 100

#: Share of the velocity's power within 20 % of its strongest frequency above which a record counts as a single sine.
_SINGLE = 0.9

#: Maximum number of samples, about, with which the frequency of a sine is determined.
_ENOUGH = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A record prepared for the fit: resampled evenly, low-passed, with its segment.

    The model is driven over all samples, but only those `inside` count; the others are the filter's edges.
    """

    #: Velocity [m/s], force [N] and, if known, displacement [m] from `reference`; low-passed, (N,) each.
    record: TimeSeries
    rate: float  #: Sampling rate [Hz].
    inside: NDArray[np.bool_]  #: Whether each sample counts (N,).
    cutoff: float  #: Cutoff frequency of the low-pass [Hz].
    reference: float  #: Reference displacement of the gas force [m]: the mean over the segment.
    single_frequency: float | None  #: Frequency [Hz] if the record is essentially one sine; else None.
    changes: tuple[str, ...]  #: Every departure from the dissertation's choices, one sentence each.
    temperature: Array | None = None  #: Temperature (N,) [K], averaged over a second; None if it was not measured.
    build: str | None = None  #: Build of the shock; None if it is not stated.

    @property
    def step(self) -> float:
        """Sampling interval [s]."""
        return 1.0 / self.rate

    @property
    def stop(self) -> float:
        """End of the segment, from the start of the record [s]."""
        return float(self.record.time[self.inside][-1])

    @property
    def measured(self) -> Array:
        """The low-passed measured force inside the segment (N,) [N]."""
        return np.asarray(self.record["force"][self.inside])

    @property
    def deviation(self) -> float:
        """Standard deviation of `measured` [N]."""
        return float(np.std(self.measured))

    def filtered(self, values: Array) -> Array:
        """Return values (..., N) behind the record's own low-pass."""
        return lowpass(values, self.rate, self.cutoff)


#: Time over which the temperature is averaged [s].
_AVERAGE = 1.0


def prepare(
    test: DynoTest,
    *,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
) -> Prepared:
    """Prepare a record for the fit.

    Args:
        test: Record of velocity and force, optionally displacement.
        segment: Start and end [s] from the record's start; default 1 to 10, or the whole record if it is shorter or
            the shock barely moves there.
        cutoff: Cutoff frequency of the 8th-order zero-phase Butterworth low-pass [Hz]; default 50, at most 0.4 of the
            sampling rate.

    Raises:
        ParameterError: An option does not suit the record.
        TooShortError: Too few samples are left.
    """
    series, changes = _even(test.series)
    cutoff_used = _cutoff(series.sample_rate, cutoff, changes)
    (start, stop), why = _choose_segment(series, segment, cutoff_used)
    changes += why
    series = _thinned(_lowpassed(series, cutoff_used), changes)
    edge = FILTER_EDGE / cutoff_used
    series = series.window(start - edge, stop + edge)
    inside = (series.time >= start) & (series.time <= stop)
    if inside.sum() < FEWEST:
        what = f"{inside.sum()} samples between {start:g} and {stop:g} s; a fit needs {FEWEST} or more"
        raise TooShortError(what, path=test.source)
    if not slower_peak(series["velocity"][inside]) > 0.0:
        raise ParameterError("the velocity never changes its sign in the segment: a fit needs both strokes")
    record, reference = _about_mean_displacement(series, inside)
    return Prepared(
        record=record,
        rate=record.sample_rate,
        inside=inside,
        cutoff=cutoff_used,
        reference=reference,
        single_frequency=single_frequency(series["velocity"][inside], series.sample_rate),
        changes=tuple(changes),
        temperature=_temperature(test.series, record.time),
        build=test.conditions.build,
    )


def _temperature(series: TimeSeries, time: Array) -> Array | None:
    """Return the temperature (N,) [K] at times (N,) [s] from the start of a record, without the sensor's noise."""
    if "temperature" not in series:
        return None
    count = max(round(_AVERAGE * series.sample_rate), 1)
    smooth = uniform_filter1d(series["temperature"], min(count, len(series)), mode="nearest")
    return np.asarray(np.interp(time, series.time - series.time[0], smooth))


def single_frequency(velocity: Array, rate: float) -> float | None:
    """Return the frequency [Hz] of a velocity (N,) that is essentially one sine, else None."""
    power = np.abs(np.fft.rfft((velocity - velocity.mean()) * np.hanning(velocity.size))) ** 2
    frequency = np.fft.rfftfreq(velocity.size, 1.0 / rate)
    strongest = float(frequency[power.argmax()])
    near = np.abs(frequency - strongest) <= max(0.2 * strongest, 2.0 * frequency[1])
    if strongest == 0.0 or power[near].sum() < _SINGLE * power.sum():
        return None
    every = max(1, velocity.size // _ENOUGH)
    return refined_frequency(velocity[::every], np.arange(velocity.size)[::every] / rate, strongest)


def refined_frequency(values: Array, time: Array, near: float) -> float:
    """Return the frequency [Hz] of the sine that fits values (N,) best, near a first estimate of a spectrum [Hz]."""

    def misfit(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * (time - time[0])
        columns = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
        return float(np.linalg.lstsq(columns, values, rcond=None)[1].sum())

    # The misfit has local minima one period over the whole record apart, so a grid is searched first.
    share = max(0.15, 0.6 / (near * float(time[-1] - time[0])))
    grid = np.linspace(1.0 - share, 1.0 + share, 61) * near
    best = int(np.argmin([misfit(frequency) for frequency in grid]))
    step = float(grid[1] - grid[0])
    found = minimize_scalar(misfit, bounds=(float(grid[best]) - step, float(grid[best]) + step), method="bounded")
    return float(found.x)


def _even(series: TimeSeries) -> tuple[TimeSeries, list[str]]:
    """Return the fit's channels on an even time axis that starts at 0."""
    names = [name for name in ("velocity", "force", "displacement") if name in series]
    series = series.select(names)
    changes = []
    if not series.is_uniform:
        changes.append(f"time steps are uneven: the record was resampled to an even {series.sample_rate:.6g} Hz")
        series = series.resample(series.sample_rate)
    even = np.arange(len(series)) / series.sample_rate
    return TimeSeries(even, series.values, series.names, series.units), changes


def _cutoff(rate: float, requested: float | None, changes: list[str]) -> float:
    highest = LARGEST_SHARE * rate
    if requested is not None:
        if not 0.0 < requested <= highest:
            raise ParameterError(
                f"the cutoff frequency must be between 0 and {highest:.4g} Hz (0.4 of the record's {rate:.4g} Hz), "
                f"not {requested:g} Hz"
            )
        if requested != CUTOFF:
            changes.append(f"cutoff frequency {requested:g} Hz as requested, instead of {CUTOFF:g} Hz")
        return requested
    if highest < CUTOFF:
        why = f"0.4 of the record's {rate:.4g} Hz"
        changes.append(f"cutoff frequency lowered from {CUTOFF:g} to {highest:.4g} Hz: {why}")
    return min(CUTOFF, highest)


def _lowpassed(series: TimeSeries, cutoff: float) -> TimeSeries:
    values = lowpass(series.values, series.sample_rate, cutoff)
    return TimeSeries(series.time, values, series.names, series.units)


def _thinned(series: TimeSeries, changes: list[str]) -> TimeSeries:
    every = int(series.sample_rate // WORKING_RATE)
    if every < 2:
        return series
    changes.append(f"every {every}th sample of the {series.sample_rate:.6g} Hz record was used, after the low-pass")
    return series.at(slice(None, None, every))


def slower_peak(velocity: Array) -> float:
    """Return the peak speed [m/s] of the slower side of a velocity (N,) [m/s]; negative without both strokes."""
    return float(min(velocity.max(), -velocity.min()))


def _about_mean_displacement(series: TimeSeries, inside: NDArray[np.bool_]) -> tuple[TimeSeries, float]:
    if "displacement" not in series:
        return series, 0.0
    reference = float(series["displacement"][inside].mean())
    return series.with_channel("displacement", "m", series["displacement"] - reference), reference
