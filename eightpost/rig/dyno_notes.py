"""What is suspicious in a dynamometer record that can still be used: said, not refused.

What makes a record useless is an error (`eightpost.signals.faults`). The rest is here: each check returns a sentence
that says what, where, how much and what to do, or nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from eightpost.rig.lag import lag_between
from eightpost.signals.faults import clipped_samples
from eightpost.signals.filters import lowpass, velocity_from_displacement
from eightpost.signals.origin import IN_MEMORY, Origin

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

    Array = NDArray[np.float64]

#: A channel with fewer steps of its resolution over its range is coarse: rounding is then over 0.8 % of a sine.
FEWEST_LEVELS = 100
#: A change between two samples that is this share of the range (a shock's position cannot jump), and ...
JUMP_SHARE = {"velocity": 0.2, "displacement": 0.03, "force": 0.2}
#: ... this many times the usual change around it, is a jump.
JUMP_FACTOR = 10.0
#: Force may follow velocity by this much [s] (a shock's own lag, 3.3, and some filter), and lead by `LEAD` [s].
LAG, LEAD = 0.010, 0.002
#: Speeds, strokes and forces above these are not a shock's: a wrong unit [SI].
IMPLAUSIBLE = {"velocity": 10.0, "displacement": 0.6, "force": 1e5}
#: ... and largest values below these are none either.
TINY = {"velocity": 1e-3, "displacement": 1e-4, "force": 1.0}
#: ... where that is over this angle [rad] at the mean frequency: a gas spring makes so much in a slow test.
PHASE = np.deg2rad(5.0)
#: Channels that correlate so well show a lag in samples through their noise.
CLEAR = 0.98
#: Measured velocity and the slope of displacement may differ by this share in size, ...
SLOPE_SHARE = 0.1
#: ... their means by this share of velocity's standard deviation, ...
OFFSET_SHARE = 0.02
#: ... and this share of velocity's range anywhere.
APART = 0.2
#: Below this correlation of force and velocity a column or the record is in doubt.
WEAK = 0.3
#: Share of repeated samples that is worth a word.
REPEATED_SHARE = 0.02
#: Force at rest below this share of its range is negative beyond doubt.
REST_SHARE = 0.05
#: Force at rest [N] that few gas springs reach: 2 MPa on a rod of 25 mm.
STRONG_GAS = 1000.0
#: Temperature change [K] that is worth a word.
DRIFT = 5.0


def notes_of(
    series: TimeSeries, *, measured: tuple[str, ...] | None = None, origin: Origin = IN_MEMORY
) -> tuple[str, ...]:
    """Return what is suspicious in a dynamometer record, in words.

    Args:
        series: `velocity` [m/s], `force` [N], perhaps `displacement` [m] and `temperature` [K].
        measured: The channels that were measured, not derived; default all.
        origin: Where the samples came from, for the line of a fault.
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
    return f"{name}: it reaches {largest:.4g} (SI), which is no shock's; check the column's unit"


def _coarse(name: str, values: Array) -> str | None:
    """Say when a channel has few levels."""
    step = quantum(values)
    levels = float(np.ptp(values)) / step if step else np.inf
    if levels >= FEWEST_LEVELS:
        return None
    return (
        f"{name}: quantised, {levels:.0f} steps of {step:.3g} (SI) over its range; "
        "use a finer range or more digits, or read velocity from displacement"
    )


def quantum(values: Array) -> float | None:
    """Return the step to which `values` (N,) are rounded, None where they are not."""
    span = float(np.ptp(values))
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * span]
    if not steps.size:
        return None
    smallest = float(steps.min())
    multiples = steps / smallest
    return smallest if bool((np.abs(multiples - np.round(multiples)) < 0.05 * multiples).all()) else None


def _jump(name: str, series: TimeSeries, origin: Origin) -> str | None:
    """Say where a channel jumps between two samples: spikes, joined records, pasted or lost samples."""
    values = series[name]
    change = np.abs(np.diff(values))
    usual = np.maximum(median_filter(change, size=11, mode="nearest"), _noise(values))
    bad = np.flatnonzero((change > JUMP_SHARE[name] * np.ptp(values)) & (change > JUMP_FACTOR * usual))
    bad = np.array([i for i in bad if not _is_step(name, values, series, int(i))], dtype=np.intp)
    if not bad.size:
        return None
    first = int(bad[0])
    return (
        f"{name}: it jumps by {change[first]:.4g} (SI) at {_place(origin, first + 1)} ({bad.size} such places); a "
        "spike, lost samples or two records joined: cut it out"
    )


def _noise(values: Array) -> float:
    """Return the standard deviation of the white noise in `values` (N,), from their third differences."""
    return float(np.median(np.abs(np.diff(values, 3))) / (0.6745 * np.sqrt(20.0)))


def _is_step(name: str, values: Array, series: TimeSeries, i: int) -> bool:
    """Say whether a jump after sample `i` is one that a dynamometer makes: the value stays where it jumped to.

    Velocity does so at the corners of a triangle (a measured displacement bears witness of it), force by dry friction
    where velocity changes sign.
    """
    change = np.median(values[i + 1 : i + 6]) - np.median(values[max(0, i - 4) : i + 1])
    if abs(change) < 0.5 * abs(values[i + 1] - values[i]):
        return False
    if name == "velocity":
        return "displacement" in series
    speeds = series["velocity"][max(0, i - 2) : i + 4]
    return name == "force" and bool(speeds.min() <= 0.0 <= speeds.max() and change * (speeds[-1] - speeds[0]) > 0.0)


def _held(name: str, values: Array, origin: Origin) -> str | None:
    """Say where a motion channel sits at its end value: clipped, or truly held by the drive."""
    for signed, end in ((values, "highest"), (-values, "lowest")):
        samples = clipped_samples(signed, np.ones(values.size, dtype=bool))
        if samples.size:
            return (
                f"{name}: {samples.size} of {values.size} samples sit at the {end} value {values[samples[0]]:.4g} "
                f"(SI), the first at {_place(origin, int(samples[0]))}; clipped, unless the drive holds it there"
            )
    return None


def _repeated(series: TimeSeries, names: tuple[str, ...], origin: Origin) -> str | None:
    """Say when samples are copies of the one before while the shock moves, or of a whole earlier part."""
    rows = series.select(names).values
    speed = np.abs(series["velocity"])
    same = (np.diff(rows, axis=1) == 0.0).all(axis=0) & (speed[1:] > 0.1 * speed.max())
    if np.count_nonzero(same) > REPEATED_SHARE * same.size:
        return (
            f"{np.count_nonzero(same)} of {same.size + 1} samples repeat the one before, the first at "
            f"{_place(origin, int(np.argmax(same)) + 1)}: the logger's own rate is lower than the file's; export at "
            "its rate"
        )
    copy = _copied(rows)
    if copy is None:
        return None
    return (
        f"the samples at {_place(origin, copy[1])} are those at {_place(origin, copy[0])} again: a part of the record "
        "was pasted twice (or it is computed, without noise); cut it out"
    )


#: So many samples in a row that come again are a copy.
_COPIED = 20


def _copied(rows: Array) -> tuple[int, int] | None:
    """Return where a run of samples and its copy begin, None where there is none; `rows` is (C, N)."""
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
    """Compare measured velocity with the slope of displacement: time, size, offset, then sample by sample."""
    if "velocity" not in measured:
        return
    if "displacement" not in series:
        yield from _travel(series)
        return
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    cutoff = min(50.0, 0.4 * rate)
    velocity, slope = even["velocity"], velocity_from_displacement(even["displacement"], rate, cutoff)
    said = _not_the_slope(velocity, slope, rate)
    if said:
        yield said
        return
    edge = int(5.0 * rate / cutoff)  # the filter rings at the ends
    apart = np.abs(lowpass(velocity, rate, cutoff) - slope)[edge : velocity.size - edge]
    if apart.size and apart.max() > APART * np.ptp(velocity):
        place = _place(origin if even is series else IN_MEMORY, int(np.argmax(apart)) + edge)
        yield (
            f"velocity: it is {apart.max():.3g} m/s off the slope of displacement at {place}; lost samples, a spike or "
            "a clipped channel there: cut it out"
        )


def _not_the_slope(velocity: Array, slope: Array, rate: float) -> str | None:
    """Say when velocity differs from the slope of displacement in time, size or mean."""
    lag = lag_between(velocity, slope, rate)
    if abs(lag) > 1.5 / rate and _alike(velocity, slope, round(lag * rate)) > CLEAR:
        return (
            f"velocity: it {_follows(lag)} the slope of displacement by {1e3 * abs(lag):.3g} ms; the channels are not "
            "sampled together: shift one, or read velocity from displacement"
        )
    factor = float(slope.std() / velocity.std())
    if abs(factor - 1.0) > SLOPE_SHARE:
        return f"velocity: the slope of displacement is {factor:.4g} times as large; check both units, and for clipping"
    offset = float((velocity - slope).mean())
    if abs(offset) > OFFSET_SHARE * velocity.std():
        return (
            f"velocity: its mean is {offset:.3g} m/s off that of the slope of displacement: an offset; set one in the "
            "channel map"
        )
    return None


def _alike(values: Array, reference: Array, lag: int) -> float:
    """Return the correlation of `values` (N,) with `reference` (N,) `lag` samples before."""
    first, second = (values, reference) if lag >= 0 else (reference, values)
    count = values.size - abs(lag)
    return float(np.corrcoef(first[abs(lag) :], second[:count])[0, 1])


def _travel(series: TimeSeries) -> Iterator[str]:
    """Say when a velocity that nothing stands beside would carry the shock away."""
    path, time = _integral(series), series.time
    net = float(path[-1])
    stroke = float(np.ptp(path - net * (time - time[0]) / series.duration))
    if abs(net) > max(2.0 * stroke, IMPLAUSIBLE["displacement"]) or abs(net) > 5.0 * stroke:
        yield (
            f"velocity: its mean of {net / series.duration:.3g} m/s would carry the shock {net:.3g} m: an offset; "
            "set one in the channel map"
        )


def _integral(series: TimeSeries) -> Array:
    """Return the integral of velocity (N,) [m]."""
    velocity = series["velocity"]
    return np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(series.time))))


def _path(series: TimeSeries) -> Array:
    """Return displacement (N,) [m], or velocity's integral without its drift."""
    if "displacement" in series:
        return series["displacement"]
    path = _integral(series)
    return np.asarray(path - path[-1] * np.linspace(0.0, 1.0, path.size))


def _force(series: TimeSeries) -> Iterator[str]:
    """Say when the force does not go with the velocity as a damper's does."""
    velocity, force = series["velocity"], series["force"]
    correlation = float(np.corrcoef(force, velocity)[0, 1])
    if correlation < WEAK:
        yield (
            f"force: it correlates with velocity at {correlation:.2f} only; a wrong column, a spring on the "
            "dynamometer, or channels far apart in time"
        )
    if lag := lag_note(series):
        yield lag.note
    yield from _rest_force(velocity, force)


class LagNote(NamedTuple):
    """A force that follows velocity, or leads it, otherwise than a shock's."""

    delay: float
    """By which force follows velocity [s]; negative where it leads."""
    lead: float
    allowed: float
    """What force may lead and follow velocity by [s]."""
    note: str
    """In words."""


def lag_note(series: TimeSeries) -> LagNote | None:
    """Return by how much force follows or leads velocity where that is no shock's own lag."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    delay = lag_between(even["force"], even["velocity"], even.sample_rate)
    frequency = float(even["velocity"].std() / _path(even).std())  # [rad/s]
    lead, allowed = max(LEAD, 1.5 / even.sample_rate), max(LAG, PHASE / frequency)
    if -lead <= delay <= allowed:
        return None
    note = (
        f"force: it {_follows(delay)} velocity by {1e3 * abs(delay):.3g} ms, more than a shock's own lag (under "
        f"{1e3 * LAG:.0f} ms): channels sampled apart, a filter on one of them, or a spring beside the damper; a "
        "fitted lag holds it"
    )
    return LagNote(delay, lead, allowed, note)


def _rest_force(velocity: Array, force: Array) -> Iterator[str]:
    """Say when the force at standstill is no gas force."""
    rest = np.abs(velocity) <= 0.05 * np.abs(velocity).max()
    if not rest.any():
        yield f"velocity: it is never near zero ({velocity.min():.3g} to {velocity.max():.3g} m/s): an offset"
        return
    middle, span = float(np.median(force[rest])), float(np.ptp(force))
    if middle < -REST_SHARE * span:
        yield (
            f"force: {middle:.4g} N at standstill, where gas pushes with a positive force: the load cell's zero, or "
            "velocity and displacement are the channels that are positive the other way"
        )
    if middle > max(0.5 * span, STRONG_GAS):
        yield (
            f"force: {middle:.4g} N at standstill, over half of its range: a strong gas force, or the load cell's zero"
        )


def warming_note(series: TimeSeries) -> str | None:
    """Return a note where the temperature changes; None where it does not, or is not known."""
    if "temperature" not in series:
        return None
    drift = temperature_drift(series)
    if abs(drift) <= DRIFT:
        return None
    return (
        f"temperature: it changes by {drift:+.1f} K over the record, and damping with it; fit parts, and compare them"
    )


def temperature_drift(series: TimeSeries) -> float:
    """Return the change of temperature [K] over a record: the means of its last and first tenth."""
    values = series["temperature"]
    tenth = max(1, values.size // 10)
    return float(values[-tenth:].mean() - values[:tenth].mean())


def _follows(lag: float) -> str:
    return "follows" if lag > 0.0 else "leads"


def _place(origin: Origin, sample: int) -> str:
    """Say where a zero-based sample is: its line in a text file, else its number."""
    return f"{'line' if origin.lines is not None else 'sample'} {origin.line(sample)}"
