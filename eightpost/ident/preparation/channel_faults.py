"""Faults of the channels of a rig record: units, spikes, dropouts, clipping, delays, lost channels, shared causes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ConstantChannelError
from eightpost.rig.faults import Fault
from eightpost.rig.motion import delay_of
from eightpost.signals.filters import derivative, lowpass
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.verdict import Rules

RULES = Rules.read(Path(__file__).with_name("rig.txt"), "rig record")


def fault(rule: str, channels: tuple[str, ...], figure: str, remedy: str = "") -> Fault:
    """Return a fault of channels of a rig record against the rule of a name."""
    return Fault(RULES.named(rule), figure, channels=channels, remedy=remedy)


# ==== Advice on a unit ===============================================================================================

#: Units (of a column, in which it is read) that a gain betrays within a tolerance, by kind of quantity.
UNIT_TOLERANCE = 0.08
_UNITS = {
    "force": [("N", "lbf"), ("lbf", "N"), ("N", "kN"), ("kN", "N")],
    "acceleration": [("m/s2", "g_0"), ("g_0", "m/s2")],
    "length": [("mm", "in"), ("in", "mm"), ("mm", "m"), ("m", "mm")],
    "velocity": [("mm/s", "in/s"), ("in/s", "mm/s"), ("mm/s", "m/s"), ("m/s", "mm/s")],
}
_FORCES = ("tire_force", "force", "aero", "aero_force", "heave_force")


def unit_remedy(channel: str, gain: float) -> str:
    """Return advice on a channel with a wrong gain: its unit, if the gain is the ratio of two."""
    quantity = channel.rpartition(".")[2].removesuffix("_command")
    kind = "force" if quantity in _FORCES else "acceleration" if quantity.endswith("acceleration") else "length"
    for own, read in _UNITS["velocity" if quantity == "velocity" else kind]:
        if abs(gain / convert(1.0, read, own) - 1.0) < UNIT_TOLERANCE:
            return f"its unit is probably {own}, but it is read as {read}; give unit = '{own}' in the channel map"
    return RULES.named("a channel has the wrong scale").remedy


# ==== Channels that can have one fault together =======================================================================

#: Channels of each dimension, for a unit that is wrong in all of them.
DIMENSIONS = {
    "all forces": ("tire_force", "force", "aero", "aero_force", "heave_force"),
    "all accelerations": ("hub_acceleration", "chassis_acceleration", "vertical_acceleration"),
}


def fault_groups(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the sets of channels that can have one fault: each channel, a quantity at all corners, a dimension.

    The velocity of a potentiometer has its faults too, if the logger computes one from the other.
    """
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    quantities: dict[str, tuple[str, ...]] = {}
    for name in names:
        quantity = name.rpartition(".")[2]
        quantities[quantity] = (*quantities.get(quantity, ()), name)
        velocity = name.replace("displacement", "velocity")
        groups |= {f"{name} with its velocity": (name, velocity)} if velocity != name and velocity in names else {}
    groups |= {f"*.{quantity}": own for quantity, own in quantities.items() if len(own) > 1}
    pots = (*quantities.get("displacement", ()), *quantities.get("velocity", ()))
    groups |= {"*.displacement and velocity": pots} if {"displacement", "velocity"} <= quantities.keys() else {}
    return groups | {dimension: _of(names, *members) for dimension, members in DIMENSIONS.items()}


def sign_conventions(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the sets of channels that one convention of signs reverses, other than those of `fault_groups`."""
    shocks = _of(names, "force", "displacement", "velocity")
    corners = dict.fromkeys(name.rpartition(".")[0] for name in shocks)
    vertical = _of(names, "road", *DIMENSIONS["all accelerations"])
    return {
        **{
            f"all channels of the shock {corner}": tuple(n for n in shocks if n.startswith(corner))
            for corner in corners
        },
        "force and displacement of all shocks": shocks,
        "all roads and accelerations": vertical,
    }


def _of(names: Sequence[str], *quantities: str) -> tuple[str, ...]:
    return tuple(name for name in names if name.rpartition(".")[2] in quantities)


# ==== Faults that the samples of one channel show: spikes, dropouts, clipping ========================================

FACTOR = 12.0  # deviation of a spike from its neighbours, of the usual one, ...
SHARE, SHARE_OF_ACCELERATION = 0.5, 3.0  # ... and of the standard deviation; friction makes steps of accelerations
BUMP, SAME_TIME = 6.0, 0.02  # another channel that deviates this much (of its usual one) within this time [s]: a bump
DISTANCES = (1, 2)  # of the neighbours in samples: longer ones find spikes of several samples
LOCAL, STRIDE = 1.0, 5  # the usual deviation is that of every n-th sample over this length [s]
HELD, REPEATS = 0.02, 0.2  # time for which a dropout repeats a value [s]; share of repeats in a coarse channel

# ---- Spikes and dropouts --------------------------------------------------------------------------------------------


def spikes(series: TimeSeries, *, computed: Sequence[str] = ()) -> Iterator[Fault]:
    """Yield the channels with spikes or steps; channels that may be `computed` from others are no witnesses of a bump.

    A sample is predicted by the cubic through its neighbours, x_0 = (4 (x_-d + x_d) - (x_-2d + x_2d)) / 6.
    """
    places: dict[str, set[int]] = {name: set() for name in series.names}
    rate = series.sample_rate
    reach = max(1, round(SAME_TIME * rate))
    for distance in DISTANCES:
        sharp, moved = {}, {}  # places where a channel may have a spike, and where it is a witness
        for name in series.names:
            values, share = series[name], SHARE_OF_ACCELERATION if name.endswith("acceleration") else SHARE
            scores = _scores(values, distance, round(LOCAL * rate))
            large = np.abs(_deviations(values, distance)) > share * float(values.std())
            sharp[name], moved[name] = np.flatnonzero(large & (scores > FACTOR)), np.flatnonzero(scores > BUMP)
        for name, own in sharp.items():
            others = [moved[other] for other in series.names if other not in (name, *computed)]
            seen = [
                np.searchsorted(other, own - reach) < np.searchsorted(other, own + reach, "right") for other in others
            ]
            places[name].update(own[~np.any(seen, axis=0)].tolist() if seen else own.tolist())
    yield from (_spike(series, name, np.array(sorted(own))) for name, own in places.items() if own)


def _deviations(values: Array, d: int) -> Array:
    """Return the deviation of each sample (N,) from its neighbours; 0 near the ends."""
    size = values.size
    deviations = np.zeros(size)
    predicted = 4.0 * (values[d : size - 3 * d] + values[3 * d : size - d])
    predicted -= values[: size - 4 * d] + values[4 * d :]
    predicted /= 6.0
    np.subtract(values[2 * d : size - 2 * d], predicted, out=deviations[2 * d : size - 2 * d])
    return deviations


def _scores(values: Array, distance: int, block: int) -> Array:
    """Return the deviations (N,) in multiples of the usual one, the median in blocks of the record."""
    deviations = np.abs(_deviations(values, distance))
    count = max(1, values.size // max(8, block))
    size = values.size // count
    usual = np.median(deviations[: count * size].reshape(count, size)[:, ::STRIDE], axis=1) / 0.6745
    usual = np.maximum(usual, 1e-6 * float(values.std()) + 1e-300)
    deviations[: count * size].reshape(count, size)[:] /= usual[:, None]
    deviations[count * size :] /= usual[-1]
    return deviations


def _spike(series: TimeSeries, name: str, places: NDArray[np.intp]) -> Fault:
    deviations = np.max([np.abs(_deviations(series[name], distance)) for distance in DISTANCES], axis=0)[places]
    groups = np.split(np.arange(places.size), 1 + np.flatnonzero(np.diff(places) > 4 * max(DISTANCES)))
    peak = groups[0][int(np.argmax(deviations[groups[0]]))]
    many = f"{len(groups)} spikes or steps, the first" if len(groups) > 1 else "a spike"
    where = f"at {series.time[places[peak]]:.4g} s ({deviations[peak] / series[name].std():.1f} standard deviations)"
    return fault("a channel has spikes or dropouts", (name,), f"{name} has {many} {where}, which no other channel sees")


def dropouts(series: TimeSeries) -> Iterator[Fault]:
    """Yield the channels that repeat a value while the others move; not those whose resolution is coarse."""
    rate = series.sample_rate
    for name in series.names:
        values = series[name]
        start, stop = _longest_hold(values)
        is_long = stop - start >= max(10.0, HELD * rate) and values.min() < values[start] < values.max()
        if not is_long or float(np.mean(np.diff(values) == 0.0)) > REPEATS:
            continue
        if _others_move(series, series.names, name, slice(start, stop)):
            where = f"from {series.time[start]:.5g} s to {series.time[stop]:.5g} s"
            yield fault(
                "a channel has spikes or dropouts",
                (name,),
                f"{name} repeats one value {where} while the other channels move",
            )


# ---- Clipping -------------------------------------------------------------------------------------------------------

FLAT, CLIPPED_SHARE, PEAKS = 0.04, 0.0035, 4  # distance from the extreme [standard deviations]; share of samples; peaks
VALLEY = 0.5  # distance that separates two peaks [standard deviations]
UNLOADED = 0.05  # share of a tire's mean force below which it is off the ground


def clipped(series: TimeSeries) -> Iterator[Fault]:
    """Yield the channels of a broadband record of which several peaks end at one value."""
    for name in series.names:
        samples = series[name]
        scale, mean = float(samples.std()), float(samples.mean())
        for side, sign in (("highest", 1.0), ("lowest", -1.0)):
            values = sign * samples
            top = float(values.max())
            if scale == 0.0 or (name.endswith("tire_force") and abs(top) < UNLOADED * abs(mean)):
                continue
            flat = values > top - FLAT * scale
            if (share := float(np.mean(flat))) > CLIPPED_SHARE and _peaks(flat, values > top - VALLEY * scale) >= PEAKS:
                text = f"{100.0 * share:.1f} % of the samples of {name} are at the {side} value {sign * top:.6g} (SI)"
                yield fault("a channel is clipped", (name,), text)


def _peaks(flat: NDArray[np.bool_], high: NDArray[np.bool_]) -> int:
    """Return the number of separate stretches of high samples with flat ones."""
    stretch = np.cumsum(np.diff(high.astype(np.int8), prepend=0) == 1)
    return int(np.unique(stretch[flat]).size)


# ==== Channels that fail during a record: a cable breaks, or a logger repeats its last value =========================

LOST_SPAN = 0.25  #: Time for which a failed channel repeats one value [s] ...
MOVING = 0.5  #: ... and fraction of its samples in which another channel changes if it moves [1].

_RESPONSES = ("tire_force", "displacement", "force", "hub_acceleration", "chassis_acceleration")


def check_lost_channels(series: TimeSeries, corners: Sequence[str], *, path: Path | None = None) -> None:
    """Check that no channel becomes constant while the others move.

    Args:
        series: Rig record.
        corners: Names of its corners; one empty name for a quarter car.
        path: Path of its file, for messages.

    Raises:
        ConstantChannelError: A channel becomes constant.
    """
    names = [f"{c}.{q}" if c else q for q in _RESPONSES for c in corners]
    there, rate = [name for name in names if name in series], series.sample_rate
    for name in there:
        start, stop = _longest_hold(series[name])
        span = (stop - start) / rate
        if span < LOST_SPAN or not _others_move(series, there, name, slice(start, stop)):
            continue
        where = f"from {series.time[start]:.4g} s to {series.time[stop]:.4g} s"
        what = (
            f"it stays at {series[name][start]:.6g} (SI) {where} ({span:.3g} s) while the other channels move: a cable "
            "or a logger failed there; remove that part of the record, or remove the channel from the map"
        )
        raise ConstantChannelError(what, path=path, channel=name)


def _longest_hold(values: Array) -> tuple[int, int]:
    """Return the first and the last sample of the longest run of one value."""
    edges = np.flatnonzero(np.diff(values) != 0.0) + 1
    bounds = np.concatenate(([0], edges, [values.size]))
    longest = int(np.argmax(np.diff(bounds)))
    return int(bounds[longest]), int(bounds[longest + 1]) - 1


def _others_move(series: TimeSeries, names: Sequence[str], own: str, held: slice) -> bool:
    """Return whether most of the other channels change in most samples of a span; a resting rig moves none."""
    moving = [np.mean(np.diff(series[name][held]) != 0.0) > MOVING for name in names if name != own]
    return bool(moving) and float(np.mean(moving)) > 0.5


# ==== Time lags between channels, loggers and runs, estimated by cross-correlation ===================================

LONGEST_START = 10.0  #: Longest time between the starts of two runs [s].
BAND = 20.0  #: Upper end of the band of the comparisons [Hz], at most 0.4 of the sample rate.
SPAN = 60.0  #: Length of record that is compared [s]; longer ones take seconds and give no better result.
#: Longest lag of a potentiometer in a sound record [s]: rubber in series with its shock makes it late by up to 6 ms. A
#: single late potentiometer follows from the laws of the corners (`plausibility`).
TRAVEL_LAG = 8e-3
#: Longest lag of the sum of the tire forces in a sound record [s]: an engine on its mounts, whose acceleration is not
#: measured, shifts it by up to 30 ms. Shorter delays of tire forces follow from the law of the tire (`plausibility`).
LOAD_LAG = 50e-3
DRIFT = 4e-3  #: Longest change of a lag within a sound record [s]; that of the tire forces may reach `LOAD_LAG`.
DEVIATIONS = 5.0  #: Number of its standard deviations by which a lag must exceed the threshold.
SMALLEST_CORRELATION = 0.6  #: Smallest correlation of a lag; below it the lag is chance or has another cause.


class Lag(NamedTuple):
    """Time lag of a channel."""

    channel: str  #: Name of the channel or of the group of channels.
    against: str  #: Reference that the channel must be in step with.
    seconds: float  #: Lag [s]; positive if `channel` is late.
    correlation: float  #: Multiple correlation at that lag [1].
    usual: float  #: Lag up to which the channel is considered in step [s].
    #: Standard deviation of the lag [s]; it is large for slow motions, whose correlation has a flat peak.
    spread: float = 0.0

    @property
    def is_notable(self) -> bool:
        """Whether the channel is out of step."""
        is_certain = abs(self.seconds) > self.usual + DEVIATIONS * self.spread
        return self.correlation >= SMALLEST_CORRELATION and is_certain

    @property
    def drift_text(self) -> str:
        """Description of a lag that `drifts` returned."""
        return (
            f"{self.channel} falls behind {self.against} by {1e3 * self.seconds:.2f} ms: a logger lost samples, or two "
            "clocks differ"
        )

    def __str__(self) -> str:
        side = "behind" if self.seconds >= 0.0 else "ahead of"
        return (
            f"{self.channel} is {1e3 * abs(self.seconds):.2f} ms {side} {self.against} "
            f"(correlation {self.correlation:.2f})"
        )


def record_lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return the lags in the first `SPAN` of a record, for all mechanisms whose channels it contains.

    Args:
        series: Rig record.
        corners: Names of its corners; one empty name for a quarter car.
    """
    return _lags(series.window(series.time[0], series.time[0] + SPAN), corners)


def drifts(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return the notable changes of lags between the start and the end of a record.

    Such a drift appears if a logger lost samples without a gap in its time, or if two clocks run at different rates.

    Args:
        series: Rig record; if it is shorter than two spans, its halves are compared.
        corners: Names of its corners; one empty name for a quarter car.
    """
    span = min(SPAN, 0.5 * series.duration)
    first, last = series.time[0], series.time[-1]
    ends = (series.window(first, first + span), series.window(last - span, last))
    changes = [
        late._replace(
            seconds=late.seconds - early.seconds,
            correlation=min(early.correlation, late.correlation),
            usual=late.usual if late.channel == "tire_force" else DRIFT,
            spread=float(np.hypot(early.spread, late.spread)),
        )
        for early, late in zip(*(_lags(end, corners) for end in ends), strict=True)
    ]
    return tuple(change for change in changes if change.is_notable)


def _lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    comparison = _Comparison(series, tuple(corners))
    lags = [*map(comparison.travel, corners), *map(comparison.force, corners), comparison.loads()]
    return tuple(lag for lag in lags if lag is not None)


def drive_lag(series: TimeSeries, first: TimeSeries, channel: str) -> Lag:
    """Return the lag of the drive in a record behind the same drive in the first record, from a channel of both.

    Args:
        series: Record.
        first: First record, at the same rate.
        channel: Name of the channel, preferably a wheelloader's position.
    """
    size, rate = min(len(series), len(first)), series.sample_rate
    rough = delay_of(series[channel][:size], first[channel][:size], rate, band=BAND, longest=LONGEST_START)
    late = round(rough.seconds * rate)
    # Repeated over the common part, because ends that only one record has displace the peak.
    own, other = series[channel][max(late, 0) :], first[channel][max(-late, 0) :]
    size = min(own.size, other.size)
    rest = delay_of(own[:size], other[:size], rate, band=BAND, longest=2.0 / rate)
    return Lag(channel, "that of the first record", late / rate + rest.seconds, rest.correlation, 0.5 / rate)


def advance_channels(series: TimeSeries, delays: Mapping[str, float]) -> TimeSeries:
    """Return the record with late channels advanced by their delays, by cubic splines.

    The ends of the record that not all channels cover are removed.

    Args:
        series: Evenly sampled record.
        delays: Delay of each late channel [s]; other channels do not change.

    Raises:
        MissingChannelError: A channel is not in the record.
    """
    moved = {series.names.index(name): delay for name, delay in delays.items() if series[name].size and delay}
    if not moved:
        return series
    step, time, values = 1.0 / series.sample_rate, series.time, series.values.copy()
    for row, delay in moved.items():
        values[row] = CubicSpline(time, values[row])(time + delay)
    late, early = max(0.0, *moved.values()), max(0.0, *(-delay for delay in moved.values()))
    kept = slice(int(np.ceil(early / step - 1e-9)), len(series) - int(np.ceil(late / step - 1e-9)))
    return TimeSeries(time[kept], values[:, kept], series.names, series.units)


_AT_CORNERS = (
    "displacement", "velocity", "force", "tire_force", "hub_acceleration", "chassis_acceleration", "aero",
)  # fmt: skip
_ONCE = ("aero_force", "heave_force")


class _Comparison:
    """Low-passed channels of one record, for comparison with each other."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...]) -> None:
        self._corners, self._rate = corners, series.sample_rate
        known = {*(channel(corner, quantity) for corner in corners for quantity in _AT_CORNERS), *_ONCE}
        chosen = series.select([name for name in series.names if name in known])
        centred = chosen.values - chosen.values.mean(axis=1, keepdims=True)
        low = lowpass(centred, self._rate, min(BAND, 0.4 * self._rate))
        self._low = dict(zip(chosen.names, low, strict=True))

    def travel(self, corner: str) -> Lag | None:
        """Return the lag of the potentiometer behind the accelerometers above and below it, and across the axle.

        A shock that is mounted inboard on a solid axle moves with both wheels.
        """
        pot = channel(corner, "displacement")
        if not self._there([pot, *self._accelerometers(corner)]):
            return None
        axle = self._corners[:2] if corner in self._corners[:2] else self._corners[2:]
        across = (other for other in axle if other != corner and self._there(self._accelerometers(other)))
        compared = [corner, *across]
        relative = [self._low[hub] - self._low[chassis] for hub, chassis in map(self._accelerometers, compared)]
        bend = derivative(derivative(self._low[pot], self._rate), self._rate)
        return self._lag(pot, "the accelerometers", bend, np.stack(relative), TRAVEL_LAG)

    def _accelerometers(self, corner: str) -> tuple[str, str]:
        return channel(corner, "hub_acceleration"), channel(corner, "chassis_acceleration")

    def force(self, corner: str) -> Lag | None:
        """Return the lag of the load cell behind the velocity of its shock."""
        force, velocity = channel(corner, "force"), channel(corner, "velocity")
        if not self._there([force, velocity]):
            return None
        return self._lag(force, velocity, self._low[force], self._low[velocity], 0.015)

    def loads(self) -> Lag | None:
        """Return the lag of the sum of the tire forces behind the accelerations of the whole car."""
        quantities = ("tire_force", "hub_acceleration", "chassis_acceleration")
        if not all(self._there([channel(corner, quantity) for corner in self._corners]) for quantity in quantities):
            return None
        total = self._sum("tire_force", self._corners)
        down = [name for name in (*(channel(c, "aero") for c in self._corners), "aero_force") if name in self._low]
        up = [name for name in ("heave_force",) if name in self._low]
        total = total - sum((self._low[name] for name in down), start=np.zeros(total.size))
        total = total + sum((self._low[name] for name in up), start=np.zeros(total.size))
        axles = [part for part in (self._corners[:2], self._corners[2:]) if part]
        inertia = np.stack([self._sum(quantity, axle) for quantity in quantities[1:] for axle in axles])
        return self._lag("tire_force", "the accelerometers", total, inertia, LOAD_LAG)

    def _lag(self, channel: str, against: str, values: Array, references: Array, usual: float) -> Lag:
        top = delay_of(values, references, self._rate, band=BAND)
        return Lag(channel, against, top.seconds, top.correlation, max(usual, 0.5 / self._rate), top.spread)

    def _sum(self, quantity: str, corners: Sequence[str]) -> Array:
        return np.asarray(np.sum([self._low[channel(corner, quantity)] for corner in corners], axis=0))

    def _there(self, names: Sequence[str]) -> bool:
        return all(name in self._low for name in names)
