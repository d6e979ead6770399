"""The runs of a fit: prepared records that are fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.errors import ParameterError, TooShortError
from eightpost.ident.shock.simulation import RowFilter
from eightpost.rig.dyno_test import SMALLEST_SPREAD, DynoTest
from eightpost.rig.plausibility import SEGMENT
from eightpost.signals import TimeSeries, lowpass

# ==== Records: choice of the segment, filters, thinning ==============================================================

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
class PreparedRun:
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
) -> PreparedRun:
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
    low = lowpass(series.values, series.sample_rate, cutoff_used)
    series = _thinned(TimeSeries(series.time, low, series.names, series.units), changes)
    edge = FILTER_EDGE / cutoff_used
    series = series.window(start - edge, stop + edge)
    inside = (series.time >= start) & (series.time <= stop)
    if inside.sum() < FEWEST:
        what = f"{inside.sum()} samples between {start:g} and {stop:g} s; a fit needs {FEWEST} or more"
        raise TooShortError(what, path=test.source)
    if not slower_peak(series["velocity"][inside]) > 0.0:
        raise ParameterError("the velocity never changes its sign in the segment: a fit needs both strokes")
    record, reference = _about_mean_displacement(series, inside)
    return PreparedRun(
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


# ==== Strokes of the records: the ranges of their lengths, peak speeds and frequencies ===============================

#: Speed below which the shock counts as at rest, over the peak speed of the record.
_AT_REST = 0.02

#: Share of the time at either end of a range that does not count.
_LEFT_OUT = 0.1

#: Frequencies of strokes within this factor are one frequency.
ONE_FREQUENCY = 1.5


@dataclass(frozen=True, slots=True)
class StrokeRange:
    """Ranges of the strokes of records, each without a tenth of the time at either end."""

    stroke: tuple[float, float]  #: Lengths [m].
    speed: tuple[float, float]  #: Peak speeds [m/s].
    frequency: tuple[float, float]  #: Frequencies [Hz]: the inverse of twice the duration of a stroke.

    @classmethod
    def of(cls, prepared: Sequence[PreparedRun]) -> StrokeRange:
        """Return the ranges of prepared records."""
        found = [strokes(p.record["velocity"][p.inside], p.step) for p in prepared]
        stroke, speed, duration = np.hstack(found)
        return cls(*(_range(values, duration) for values in (stroke, speed, 0.5 / duration)))

    @property
    def has_one_frequency(self) -> bool:
        """Whether nearly all strokes have the same frequency, as in a sine."""
        low, high = self.frequency
        return high <= ONE_FREQUENCY * low

    def __str__(self) -> str:
        millimetres = (1e3 * self.stroke[0], 1e3 * self.stroke[1])
        return f"strokes of {_ends(millimetres)} mm, peak speeds of {_ends(self.speed)} m/s, {_ends(self.frequency)} Hz"


def strokes(velocity: Array, step: float) -> Array:
    """Return length [m], peak speed [m/s] and duration [s] of each stroke of a velocity (N,), as (3, S).

    The first and the last stroke of a record are incomplete; they count only if there is no other one.
    """
    moving = np.flatnonzero(np.abs(velocity) > _AT_REST * np.abs(velocity).max())
    turns = moving[1:][np.diff(np.sign(velocity[moving])) != 0.0]
    if turns.size < 2:
        turns = np.array([0, *turns, velocity.size])
    velocity, starts = velocity[: turns[-1]], turns[:-1]
    length = np.abs(np.add.reduceat(velocity, starts)) * step
    return np.array([length, np.maximum.reduceat(np.abs(velocity), starts), np.diff(turns) * step])


def _ends(ends: tuple[float, float]) -> str:
    low, high = (f"{end:.2g}" for end in ends)
    return low if low == high else f"{low} to {high}"


def _range(values: Array, duration: Array) -> tuple[float, float]:
    order = np.argsort(values)
    share = np.cumsum(duration[order]) / duration.sum()
    low, high = np.searchsorted(share, [_LEFT_OUT, 1.0 - _LEFT_OUT])
    return float(values[order[low]]), float(values[order[high]])


# ==== Runs ===========================================================================================================

#: Runs whose peak speeds and frequencies are within this factor have one motion.
ONE_MOTION = 1.5


@dataclass(frozen=True, eq=False)
class Runs:
    """Prepared records that are fitted together, with N samples and R rows in total."""

    prepared: tuple[PreparedRun, ...]  #: One or more records.
    weights: Array  #: Weights (R,) of the rows, 0 to 1.

    @classmethod
    def of(cls, prepared: Sequence[PreparedRun]) -> Runs:
        """Return prepared records as runs whose rows all have weight 1."""
        runs = cls(tuple(prepared), np.empty(0))
        return runs.weighted(np.ones(sum(f.rows.size for f in runs.filters)))

    @property
    def first(self) -> PreparedRun:
        """The first run, for values that all runs share."""
        return self.prepared[0]

    @cached_property
    def filters(self) -> tuple[RowFilter, ...]:
        """The filter to the rows of each run."""
        return tuple(RowFilter.of(p.inside, p.rate, p.cutoff) for p in self.prepared)

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """The slice of each run's samples among all samples."""
        ends = np.cumsum([0, *(len(p.record) for p in self.prepared)]).tolist()
        return tuple(slice(start, stop) for start, stop in pairwise(ends))

    @cached_property
    def velocity(self) -> Array:
        """Damper velocity (N,) [m/s]."""
        return np.concatenate([p.record["velocity"] for p in self.prepared])

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each sample (N,) counts."""
        return np.concatenate([p.inside for p in self.prepared])

    @cached_property
    def measured(self) -> Array:
        """The low-passed measured force of the samples that count [N]."""
        return np.concatenate([p.measured for p in self.prepared])

    @cached_property
    def target(self) -> Array:
        """The measured force at the rows (R,) [N]."""
        return np.concatenate([p.record["force"][f.rows] for p, f in zip(self.prepared, self.filters, strict=True)])

    @cached_property
    def row_velocity(self) -> Array:
        """Damper velocity at the rows (R,) [m/s]."""
        return np.concatenate([p.record["velocity"][f.rows] for p, f in zip(self.prepared, self.filters, strict=True)])

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of `measured`, each run about its own mean [N]."""
        squares = [float(np.var(p.measured)) * p.measured.size for p in self.prepared]
        return float(np.sqrt(sum(squares) / self.measured.size))

    @cached_property
    def covariate(self) -> Array:
        """Slow influence on a shock at the rows (R,): the temperature [K] about its mean over all runs.

        If a run has no temperature, or if it changes by less than 1 K, it is the time of each run about its middle [s].
        """
        pairs = list(zip(self.prepared, self.filters, strict=True))
        known = [p.temperature[f.rows] for p, f in pairs if p.temperature is not None]
        if len(known) == len(pairs):
            temperature = np.concatenate(known)
            if np.ptp(temperature) >= SMALLEST_SPREAD:
                return np.asarray(temperature - temperature.mean())
        times = [p.record.time[f.rows] for p, f in pairs]
        return np.concatenate([time - time.mean() for time in times])

    @property
    def builds(self) -> tuple[str, ...]:
        """The builds of the shock in the order of the runs; empty if a run does not state its build."""
        names = [p.build for p in self.prepared]
        return tuple(dict.fromkeys(name for name in names if name is not None)) if None not in names else ()

    @property
    def rate(self) -> float:
        """The lowest sampling rate [Hz]."""
        return min(p.rate for p in self.prepared)

    @cached_property
    def motions(self) -> list[tuple[float, float]]:
        """Peak speed [m/s] and frequency of the median stroke [Hz] of each run."""
        found = []
        for p in self.prepared:
            _, speed, duration = strokes(p.record["velocity"][p.inside], p.step)
            found.append((float(speed.max()), float(0.5 / np.median(duration))))
        return found

    @property
    def has_repeated_motions(self) -> bool:
        """Whether every run has another one of nearly the same motion, from which it can be predicted."""
        numbered = list(enumerate(self.motions))
        return all(any(_are_alike(one, other) for k, other in numbered if k != n) for n, one in numbered)

    @property
    def has_repeated_builds(self) -> bool:
        """Whether there are several builds, and every run has one of nearly the same motion in another build."""
        pairs = [(p.build, motion) for p, motion in zip(self.prepared, self.motions, strict=True)]
        return len(self.builds) > 1 and all(
            any(other != build and _are_alike(motion, one) for other, one in pairs) for build, motion in pairs
        )

    @property
    def has_one_motion(self) -> bool:
        """Whether every run is one sine, and their peak speeds and frequencies are nearly equal."""
        return self._are_sines and all(_are_alike(self.motions[0], motion) for motion in self.motions)

    @property
    def are_two_sines(self) -> bool:
        """Whether there are two runs, each of them one sine."""
        return len(self.prepared) == 2 and self._are_sines

    @property
    def _are_sines(self) -> bool:
        return all(p.single_frequency is not None for p in self.prepared)

    @property
    def changes(self) -> tuple[str, ...]:
        """Every departure from the dissertation's choices, with the number of the run if there are several."""
        if len(self.prepared) == 1:
            return self.first.changes
        numbered = enumerate(self.prepared, start=1)
        return tuple(f"run {number}: {change}" for number, run in numbered for change in run.changes)

    def rows(self, values: Array) -> Array:
        """Return the low-passed rows (..., R) of values (..., N)."""
        parts = zip(self.filters, self.parts, strict=True)
        return np.concatenate([f(values[..., part]) for f, part in parts], axis=-1)

    def weighted(self, weights: Array) -> Runs:
        """Return the same runs with weights (R,) of their rows."""
        return replace(self, weights=weights)

    def thinned(self, by: int) -> tuple[Runs, NDArray[np.intp]]:
        """Return the runs with every `by`-th sample, at the same rows, and the indices (M,) of these samples."""
        starts = [f.first % by for f in self.filters]
        kept = [np.arange(part.start + start, part.stop, by) for part, start in zip(self.parts, starts, strict=True)]
        prepared = tuple(_every(p, start, by) for p, start in zip(self.prepared, starts, strict=True))
        return replace(self, prepared=prepared), np.concatenate(kept)

    def blocks(self, duration: float) -> list[slice]:
        """Return consecutive blocks of rows of about a duration [s] each; no block spans two runs."""
        blocks, start = [], 0
        for f in self.filters:
            pieces = max(round(f.rows.size / (duration * f.row_rate)), 1)
            ends = start + np.linspace(0, f.rows.size, pieces + 1).astype(int)
            blocks += [slice(int(a), int(b)) for a, b in pairwise(ends)]
            start += f.rows.size
        return blocks


def _are_alike(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return all(max(a, b) <= ONE_MOTION * min(a, b) for a, b in zip(one, other, strict=True))


def _every(prepared: PreparedRun, start: int, by: int) -> PreparedRun:
    kept = slice(start, None, by)
    temperature = None if prepared.temperature is None else prepared.temperature[kept]
    record, inside = prepared.record.at(kept), prepared.inside[kept]
    return replace(prepared, record=record, rate=prepared.rate / by, inside=inside, temperature=temperature)


def prepare_runs(
    tests: Sequence[DynoTest],
    *,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
) -> Runs:
    """Prepare records to be fitted together.

    Raises:
        ParameterError: There is no record.
        DataError: A record has a fault; see `prepare`.
    """
    if not tests:
        raise ParameterError("no record to fit; give one or more")
    return Runs.of([prepare(test, segment=segment, cutoff=cutoff) for test in tests])
