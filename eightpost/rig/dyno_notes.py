"""Notes on what is suspicious in a dynamometer test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.rig.lag import channel_lag
from eightpost.rig.plausibility import unit_ratio
from eightpost.rig.temperature_drift import warming_note
from eightpost.signals.faults import IN_MEMORY, Origin, clipped_samples
from eightpost.signals.filters import lowpass, velocity_from_displacement, white_noise

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ---- Notes on suspicious features of a dynamometer record that is still usable --------------------------------------

#: Minimum number of resolution steps over the range of a channel; with fewer, rounding exceeds 0.8 % of a sine.
FEWEST_LEVELS = 100
#: A change between two samples is a jump if it exceeds this share of the range (a position cannot jump), and ...
JUMP_SHARE = {"velocity": 0.2, "displacement": 0.03, "force": 0.2}
#: ... this multiple of the median change around it.
JUMP_FACTOR = 10.0
#: Maximum plausible velocity, stroke and force of a shock [SI]; larger values indicate a wrong unit.
IMPLAUSIBLE = {"velocity": 10.0, "displacement": 0.6, "force": 1e5}
#: Minimum plausible values [SI]; smaller maxima also indicate a wrong unit.
TINY = {"velocity": 1e-3, "displacement": 1e-4, "force": 1.0}
#: Maximum lag of velocity behind the slope of displacement [samples].
SAMPLES = 1.5
#: Maximum relative difference in size between measured velocity and the slope of displacement, ...
SLOPE_SHARE = 0.1
#: ... maximum difference of their means as a share of the standard deviation of velocity, ...
OFFSET_SHARE = 0.02
#: ... and maximum difference at any sample as a share of the range of velocity.
APART = 0.2
#: Minimum correlation of force and velocity; below, a column or the record is suspicious.
WEAK = 0.3
#: Share of repeated samples that gives a note.
REPEATED_SHARE = 0.02
#: Force at rest [N] that few gas springs reach: 2 MPa on a rod of 25 mm.
STRONG_GAS = 1000.0


def notes_of(
    series: TimeSeries, *, measured: tuple[str, ...] | None = None, origin: Origin = IN_MEMORY
) -> tuple[str, ...]:
    """Return notes on suspicious features of a dynamometer record.

    Args:
        series: Record with `velocity` [m/s], `force` [N], and optionally `displacement` [m] and `temperature` [K].
        measured: Names of the channels that were measured, not derived; default all.
        origin: Origin of the samples, for line numbers in notes.
    """
    names = tuple(name for name in series.names if measured is None or name in measured)
    moving = tuple(name for name in ("velocity", "displacement", "force") if name in names)
    found: list[str | None] = []
    for name in moving:
        values = series[name]
        found += [_implausible(name, values), _coarse(name, values), _jump(name, series, origin)]
        if name != "force":
            found.append(_held(name, values, origin))
    found += [_repeated(series, moving, origin), *_motion(series, names, origin), *_force(series)]
    found.append(warming_note(series))
    return tuple(note for note in found if note)


def _implausible(name: str, values: Array) -> str | None:
    largest = float(np.ptp(values)) if name == "displacement" else float(np.abs(values).max())
    if TINY[name] <= largest <= IMPLAUSIBLE[name]:
        return None
    return f"{name}: it reaches {largest:.4g} (SI), which is not plausible for a shock; check the column's unit"


def _coarse(name: str, values: Array) -> str | None:
    """Return a note if a channel has few levels."""
    step = _quantum(values)
    levels = float(np.ptp(values)) / step if step else np.inf
    if levels >= FEWEST_LEVELS:
        return None
    return (
        f"{name}: quantised, {levels:.0f} steps of {step:.3g} (SI) over its range; "
        "use a finer range or more digits, or derive velocity from displacement"
    )


def _quantum(values: Array) -> float | None:
    """Return the step to which `values` (N,) are rounded, or None if they are not rounded."""
    span = float(np.ptp(values))
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * span]
    if not steps.size:
        return None
    smallest = float(steps.min())
    multiples = steps / smallest
    return smallest if bool((np.abs(multiples - np.round(multiples)) < 0.05 * multiples).all()) else None


def _jump(name: str, series: TimeSeries, origin: Origin) -> str | None:
    """Return a note if a channel jumps between two samples: spikes, joined records, pasted or lost samples."""
    values = series[name]
    change = np.abs(np.diff(values))
    usual = np.maximum(median_filter(change, size=11, mode="nearest"), white_noise(values))
    bad = np.flatnonzero((change > JUMP_SHARE[name] * np.ptp(values)) & (change > JUMP_FACTOR * usual))
    bad = np.array([i for i in bad if not _is_step(name, values, series, int(i))], dtype=np.intp)
    if not bad.size:
        return None
    first = int(bad[0])
    return (
        f"{name}: it jumps by {change[first]:.4g} (SI) at {_place(origin, first + 1)} ({bad.size} such places), "
        "because of a spike, lost samples or joined records; cut this part out"
    )


def _is_step(name: str, values: Array, series: TimeSeries, i: int) -> bool:
    """Return whether a jump after sample `i` is a step that a dynamometer can cause: the value stays at the new level.

    Velocity has steps at the corners of a triangle (confirmed by a measured displacement). Force has steps because of
    dry friction where velocity changes sign.
    """
    change = np.median(values[i + 1 : i + 6]) - np.median(values[max(0, i - 4) : i + 1])
    if abs(change) < 0.5 * abs(values[i + 1] - values[i]):
        return False
    if name == "velocity":
        return "displacement" in series
    speeds = series["velocity"][max(0, i - 2) : i + 4]
    return name == "force" and bool(speeds.min() <= 0.0 <= speeds.max() and change * (speeds[-1] - speeds[0]) > 0.0)


def _held(name: str, values: Array, origin: Origin) -> str | None:
    """Return a note if a motion channel stays at its maximum or minimum: clipped, or held there by the drive."""
    for signed, end in ((values, "highest"), (-values, "lowest")):
        samples = clipped_samples(signed, np.ones(values.size, dtype=bool))
        if samples.size:
            return (
                f"{name}: {samples.size} of {values.size} samples are equal to the {end} value "
                f"{values[samples[0]]:.4g} (SI), the first at {_place(origin, int(samples[0]))}; the channel is "
                "clipped, unless the drive holds it there"
            )
    return None


def _repeated(series: TimeSeries, names: tuple[str, ...], origin: Origin) -> str | None:
    """Return a note if samples repeat the one before while the shock moves, or if a part of the record is repeated."""
    rows = series.select(names).values
    speed = np.abs(series["velocity"])
    same = (np.diff(rows, axis=1) == 0.0).all(axis=0) & (speed[1:] > 0.1 * speed.max())
    if np.count_nonzero(same) > REPEATED_SHARE * same.size:
        return (
            f"{np.count_nonzero(same)} of {same.size + 1} samples repeat the one before, the first at "
            f"{_place(origin, int(np.argmax(same)) + 1)}: the sample rate of the logger is lower than that of the "
            "file; export at the rate of the logger"
        )
    copy = _copied(rows)
    if copy is None:
        return None
    return (
        f"the samples from {_place(origin, copy[1])} repeat those from {_place(origin, copy[0])}: a part of the record "
        "was pasted twice (or the record is computed, without noise); cut the copy out"
    )


#: Minimum number of consecutive repeated samples that are a copy.
_COPIED = 20


def _copied(rows: Array) -> tuple[int, int] | None:
    """Return the first sample of a repeated sequence and of its copy, or None; `rows` is (C, N)."""
    _, same = np.unique(rows, axis=1, return_inverse=True)
    keys = np.asarray(same, dtype=np.int64).ravel()
    order = np.argsort(keys, kind="stable")
    later, earlier = order[1:], order[:-1]
    twin = np.full(keys.size, -1)
    alike = keys[later] == keys[earlier]
    twin[later[alike]] = earlier[alike]
    distance = np.where(twin >= 0, np.arange(keys.size) - twin, 0)
    follows = (distance > _COPIED) & (distance == np.roll(distance, 1))
    runs = np.flatnonzero(np.convolve(follows, np.ones(_COPIED), mode="valid") == _COPIED)
    if not runs.size:
        return None
    start = int(runs[0]) - 1
    return int(twin[start]), start


def _motion(series: TimeSeries, measured: tuple[str, ...], origin: Origin) -> Iterator[str]:
    """Yield notes on differences between measured velocity and the slope of displacement."""
    if "velocity" not in measured:
        return
    if "displacement" not in series:
        yield from _travel(series)
        return
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    cutoff = min(50.0, 0.4 * rate)
    velocity, slope = even["velocity"], velocity_from_displacement(even["displacement"], rate, cutoff)
    note = _slope_note(velocity, slope, rate)
    if note:
        yield note
        return
    edge = int(5.0 * rate / cutoff)  # the filter rings at the ends
    apart = np.abs(lowpass(velocity, rate, cutoff) - slope)[edge : velocity.size - edge]
    if apart.size and apart.max() > APART * np.ptp(velocity):
        place = _place(origin if even is series else IN_MEMORY, int(np.argmax(apart)) + edge)
        yield (
            f"velocity: it is {apart.max():.3g} m/s off the slope of displacement at {place}, because of lost samples, "
            "a spike or a clipped channel; cut this part out"
        )


def _slope_note(velocity: Array, slope: Array, rate: float) -> str | None:
    """Return a note if velocity differs from the slope of displacement in time, size or mean."""
    lag = channel_lag(velocity, slope, rate)
    if lag is not None and not (lag.low <= SAMPLES / rate and -SAMPLES / rate <= lag.high):
        return (
            f"velocity: it {'follows' if lag.seconds > 0.0 else 'leads'} the slope of displacement by "
            f"{1e3 * abs(lag.seconds):.3g} ms; the channels are not sampled at the same times: shift one, or derive "
            "velocity from displacement"
        )
    factor = float(slope.std() / velocity.std())
    if unit_ratio(factor):  # `eightpost.rig.plausibility` says which units
        return None
    if abs(factor - 1.0) > SLOPE_SHARE:
        return f"velocity: the slope of displacement is {factor:.4g} times as large; check both units, and for clipping"
    offset = float((velocity - slope).mean())
    if abs(offset) > OFFSET_SHARE * velocity.std():
        return (
            f"velocity: its mean is {offset:.3g} m/s off that of the slope of displacement; correct this offset in the "
            "channel map"
        )
    return None


def _travel(series: TimeSeries) -> Iterator[str]:
    """Yield a note if the mean of velocity, in a record without displacement, is too large for a shock's travel."""
    time = series.time
    path = cumulative_trapezoid(series["velocity"], time, initial=0)
    net = float(path[-1])
    stroke = float(np.ptp(path - net * (time - time[0]) / series.duration))
    if abs(net) > max(2.0 * stroke, IMPLAUSIBLE["displacement"]) or abs(net) > 5.0 * stroke:
        yield (
            f"velocity: its mean of {net / series.duration:.3g} m/s would move the shock by {net:.3g} m; correct this "
            "offset in the channel map"
        )


def _force(series: TimeSeries) -> Iterator[str]:
    """Yield notes if force and velocity are not related as in a damper."""
    velocity, force = series["velocity"], series["force"]
    correlation = float(np.corrcoef(force, velocity)[0, 1])
    if correlation < WEAK:
        yield (
            f"force: its correlation with velocity is only {correlation:.2f}; check for a wrong column, a spring on "
            "the dynamometer, or channels sampled at different times"
        )
    yield from _rest_force(velocity, force)


def _rest_force(velocity: Array, force: Array) -> Iterator[str]:
    """Yield a note if the force at standstill is not a plausible gas force."""
    rest = np.abs(velocity) <= 0.05 * np.abs(velocity).max()
    if not rest.any():
        limits = f"{velocity.min():.3g} to {velocity.max():.3g} m/s"
        yield f"velocity: it is never near zero ({limits}); correct this offset in the channel map"
        return
    middle, span = float(np.median(force[rest])), float(np.ptp(force))
    if middle > max(0.5 * span, STRONG_GAS):
        yield (
            f"force: {middle:.4g} N at standstill, more than half of its range: a large gas force, or an offset of the "
            "load cell's zero"
        )


def _place(origin: Origin, sample: int) -> str:
    """Return the location of a zero-based sample: its line in a text file, otherwise its number."""
    return f"{'line' if origin.lines is not None else 'sample'} {origin.line(sample)}"
