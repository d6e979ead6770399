"""Spikes: samples that no neighbour and no other channel explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d

from eightpost.array_types import Array
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.rules import SPIKES
from eightpost.signals.timeseries import TimeSeries

#: Deviation from the neighbours of a spike, in multiples of the usual deviation, ...
FACTOR = 12.0
#: ... and of the standard deviation of the channel.
SHARE = 0.5
#: Deviation of another channel at the same time that makes it a bump, in multiples of its usual deviation.
BUMP = 6.0
#: Distance in time within which channels see the same bump [s].
SAME_TIME = 0.02
#: Distances of the neighbours in samples: longer ones find spikes of several samples.
DISTANCES = (1, 3)
#: Length over which the usual deviation is estimated [s].
LOCAL = 1.0


def spikes(series: TimeSeries, names: Sequence[str]) -> tuple[Finding, ...]:
    """Return the channels with spikes.

    A sample is predicted by the cubic through its neighbours: x_0 = (4 (x_-d + x_d) - (x_-2d + x_2d)) / 6.

    Args:
        series: Record.
        names: Names of the measured channels.
    """
    reach = max(1, round(SAME_TIME * series.sample_rate))
    block = max(8, round(LOCAL * series.sample_rate))
    found: dict[str, Array] = {}
    for distance in DISTANCES:
        scores = {name: _scores(series[name], distance, block) for name in names}
        for name, places in _alone(scores, reach).items():
            deviation = np.abs(_deviations(series[name], distance))[places]
            kept = places[deviation > SHARE * float(series[name].std())]
            found[name] = np.union1d(found.get(name, np.array([], dtype=np.intp)), kept)
    return tuple(_finding(series, name, places) for name, places in found.items() if places.size)


def _deviations(values: Array, distance: int) -> Array:
    """Return the deviation of each sample (N,) from its neighbours; 0 near the ends."""
    d, size = distance, values.size
    deviations = np.zeros(size)
    centre = values[2 * d : size - 2 * d]
    near = values[d : size - 3 * d] + values[3 * d : size - d]
    far = values[: size - 4 * d] + values[4 * d :]
    deviations[2 * d : size - 2 * d] = centre - (4.0 * near - far) / 6.0
    return deviations


def _scores(values: Array, distance: int, block: int) -> Array:
    """Return the deviations (N,) in multiples of the usual one, the median in blocks of the record."""
    deviations = np.abs(_deviations(values, distance))
    count = max(1, values.size // block)
    usual = np.array([np.median(part) for part in np.array_split(deviations, count)]) / 0.6745
    usual = np.maximum(usual, 1e-6 * float(values.std()) + 1e-300)
    sizes = [part.size for part in np.array_split(deviations, count)]
    return np.asarray(deviations / np.repeat(usual, sizes))


def _alone(scores: Mapping[str, Array], reach: int) -> dict[str, Array]:
    """Return the samples of each channel that deviate while no other channel does."""
    wide = {name: maximum_filter1d(score, 2 * reach + 1) > BUMP for name, score in scores.items()}
    together = np.sum(list(wide.values()), axis=0)
    return {name: np.flatnonzero((score > FACTOR) & (together - wide[name] == 0)) for name, score in scores.items()}


def _finding(series: TimeSeries, name: str, places: Array) -> Finding:
    first = int(places[0])
    groups = 1 + int(np.count_nonzero(np.diff(places) > max(DISTANCES) * 4))
    many = f"{groups} spikes, the first" if groups > 1 else "a spike"
    size = max(abs(float(_deviations(series[name], d)[first])) for d in DISTANCES) / float(series[name].std())
    text = f"{name} has {many} at {series.time[first]:.4g} s ({size:.1f} standard deviations), which no other channel sees"
    return Finding(SPIKES, (name,), text, SPIKES.remedy)
