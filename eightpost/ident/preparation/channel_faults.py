"""Faults that single channels of a rig record show: wrong units, spikes, dropouts, clipping."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.checks.fault import Fault
from eightpost.checks.rig import RULES, fault
from eightpost.ident.preparation.lags import longest_hold, others_move
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

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
    reach = max(1, round(SAME_TIME * series.sample_rate))
    for distance in DISTANCES:
        scores = {name: _scores(series[name], distance, round(LOCAL * series.sample_rate)) for name in series.names}
        for name in series.names:
            share = SHARE_OF_ACCELERATION if name.endswith("acceleration") else SHARE
            large = np.abs(_deviations(series[name], distance)) > share * float(series[name].std())
            others = [scores[other] for other in series.names if other not in (name, *computed)]
            for at in np.flatnonzero(large & (scores[name] > FACTOR)).tolist():
                near = slice(max(0, at - reach), at + reach + 1)
                if not any(other[near].max() > BUMP for other in others):
                    places[name].add(at)
    yield from (_spike(series, name, np.array(sorted(own))) for name, own in places.items() if own)


def _deviations(values: Array, d: int) -> Array:
    """Return the deviation of each sample (N,) from its neighbours; 0 near the ends."""
    size = values.size
    deviations = np.zeros(size)
    near = values[d : size - 3 * d] + values[3 * d : size - d]
    far = values[: size - 4 * d] + values[4 * d :]
    deviations[2 * d : size - 2 * d] = values[2 * d : size - 2 * d] - (4.0 * near - far) / 6.0
    return deviations


def _scores(values: Array, distance: int, block: int) -> Array:
    """Return the deviations (N,) in multiples of the usual one, the median in blocks of the record."""
    deviations = np.abs(_deviations(values, distance))
    count = max(1, values.size // max(8, block))
    size = values.size // count
    usual = np.median(deviations[: count * size].reshape(count, size)[:, ::STRIDE], axis=1) / 0.6745
    usual = np.maximum(usual, 1e-6 * float(values.std()) + 1e-300)
    return np.asarray(deviations / usual[np.minimum(np.arange(values.size) // size, count - 1)])


def _spike(series: TimeSeries, name: str, places: NDArray[np.intp]) -> Fault:
    deviations = np.max([np.abs(_deviations(series[name], distance)) for distance in DISTANCES], axis=0)[places]
    groups = np.split(np.arange(places.size), 1 + np.flatnonzero(np.diff(places) > 4 * max(DISTANCES)))
    peak = groups[0][int(np.argmax(deviations[groups[0]]))]
    many = f"{len(groups)} spikes or steps, the first" if len(groups) > 1 else "a spike"
    where = f"at {series.time[places[peak]]:.4g} s ({deviations[peak] / series[name].std():.1f} standard deviations)"
    return fault("a channel has spikes or dropouts", (name,), f"{name} has {many} {where}, which no other channel sees")


def dropouts(series: TimeSeries) -> Iterator[Fault]:
    """Yield the channels that repeat a value while the others move; not those whose resolution is coarse."""
    for name in series.names:
        values = series[name]
        start, stop = longest_hold(values)
        is_long = stop - start >= max(10.0, HELD * series.sample_rate) and values.min() < values[start] < values.max()
        if not is_long or float(np.mean(np.diff(values) == 0.0)) > REPEATS:
            continue
        if others_move(series, series.names, name, slice(start, stop)):
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
        scale, mean = float(series[name].std()), float(series[name].mean())
        for side, sign in (("highest", 1.0), ("lowest", -1.0)):
            values = sign * series[name]
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
