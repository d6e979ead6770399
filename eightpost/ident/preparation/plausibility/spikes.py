"""Spikes: samples that no neighbour and no other channel explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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
#: Share of its deviation by which a spike must also deviate from the samples of each side alone. Friction that
#: reverses, or breaks away, is a step or a kink of an acceleration, and continues one of the sides.
ONE_SIDED = 0.5
#: Deviation of the other accelerometer of a corner, in multiples of its usual deviation, that shows friction ...
PARTNER = 3.0
#: ... if the shock of the corner also reverses within this number of distances of the neighbours.
REVERSAL = 3
#: Distance in time within which channels see the same bump [s].
SAME_TIME = 0.02
#: Distances of the neighbours in samples: longer ones find spikes of several samples.
DISTANCES = (1, 3)
#: Length over which the usual deviation is estimated [s].
LOCAL = 1.0
#: The usual deviation is estimated from every n-th sample.
STRIDE = 5
#: Largest number of candidates per channel that are examined.
MOST = 1000


def spikes(series: TimeSeries, *, computed: Sequence[str] = ()) -> tuple[Finding, ...]:
    """Return the channels with spikes.

    A sample is predicted by the cubic through its neighbours, x_0 = (4 (x_-d + x_d) - (x_-2d + x_2d)) / 6, and by the
    parabolas through those of each side: a spike deviates from all three.

    Args:
        series: Record.
        computed: Names of channels that may be computed from others.
    """
    reach = max(1, round(SAME_TIME * series.sample_rate))
    block = max(8, round(LOCAL * series.sample_rate))
    found: dict[str, Array] = {}
    for distance in DISTANCES:
        scores = {name: _scores(series[name], distance, block) for name in series.names}
        for name, score in scores.items():
            candidates = np.flatnonzero(score > FACTOR)[:MOST]
            sizes = np.abs(_deviations(series[name], distance)[candidates])
            large = sizes > SHARE * float(series[name].std())
            alone = _one_sided(series[name], candidates, distance) > ONE_SIDED * sizes
            candidates = candidates[large & alone]
            measured = [other for other in series.names if other != name and other not in computed]
            others = [scores[other] for other in measured]
            partner = scores.get(_partner(name))
            velocity = f"{name.rpartition('.')[0]}.velocity"
            places = [
                place
                for place in candidates.tolist()
                if not _is_bump(others, place, reach)
                and not (
                    partner is not None
                    and velocity in series.names
                    and _is_friction(series[velocity], partner, place, distance)
                )
            ]
            found[name] = np.union1d(found.get(name, np.array([], dtype=np.intp)), places).astype(np.intp)
    return tuple(_finding(series, name, places) for name, places in found.items() if places.size)


def _is_bump(others: Sequence[Array], place: int, reach: int) -> bool:
    """Return whether another channel deviates from its neighbours at about the same time."""
    near = slice(max(0, place - reach), place + reach + 1)
    return any(float(score[near].max()) > BUMP for score in others)


def _partner(name: str) -> str:
    """Return the accelerometer on the other side of the shock; "" if the channel is no accelerometer of a corner."""
    place, _, quantity = name.rpartition(".")
    other = {"hub_acceleration": "chassis_acceleration", "chassis_acceleration": "hub_acceleration"}.get(quantity)
    return f"{place}.{other}" if other and place else ""


def _is_friction(velocity: Array, partner: Array, place: int, distance: int) -> bool:
    """Return whether the shock reverses, and its friction pushes the mass on its other side at the same time.

    Args:
        velocity: Velocity of the shock (N,) [m/s].
        partner: Scores of the accelerometer on the other side of the shock (N,).
        place: Index of the sample.
        distance: Distance of the neighbours in samples.
    """
    near = slice(max(0, place - REVERSAL * distance), place + REVERSAL * distance + 1)
    same = slice(max(0, place - distance), place + distance + 1)
    return bool(velocity[near].min() < 0.0 < velocity[near].max() and partner[same].max() > PARTNER)


def _deviations(values: Array, distance: int) -> Array:
    """Return the deviation of each sample (N,) from its neighbours; 0 near the ends."""
    d, size = distance, values.size
    deviations = np.zeros(size)
    centre = values[2 * d : size - 2 * d]
    near = values[d : size - 3 * d] + values[3 * d : size - d]
    far = values[: size - 4 * d] + values[4 * d :]
    deviations[2 * d : size - 2 * d] = centre - (4.0 * near - far) / 6.0
    return deviations


def _one_sided(values: Array, places: NDArray[np.intp], distance: int) -> Array:
    """Return the smaller deviation of samples from the parabolas before and after, x_0 = 3 x_d - 3 x_2d + x_3d.

    Args:
        values: Samples (N,).
        places: Indices of the samples (K,).
        distance: Distance d of the neighbours; negative before the sample.
    """
    sides = []
    for d in (-distance, distance):
        near = [values[np.clip(places + k * d, 0, values.size - 1)] for k in (1, 2, 3)]
        sides.append(np.abs(values[places] - (3.0 * (near[0] - near[1]) + near[2])))
    return np.asarray(np.minimum(*sides))


def _scores(values: Array, distance: int, block: int) -> Array:
    """Return the deviations (N,) in multiples of the usual one, the median in blocks of the record."""
    deviations = np.abs(_deviations(values, distance))
    count = max(1, values.size // block)
    size = values.size // count
    usual = np.median(deviations[: count * size].reshape(count, size)[:, ::STRIDE], axis=1) / 0.6745
    usual = np.maximum(usual, 1e-6 * float(values.std()) + 1e-300)
    return np.asarray(deviations / usual[np.minimum(np.arange(values.size) // size, count - 1)])


def _finding(series: TimeSeries, name: str, places: Array) -> Finding:
    deviations = np.max([np.abs(_deviations(series[name], distance)) for distance in DISTANCES], axis=0)[places]
    groups = np.split(np.arange(places.size), 1 + np.flatnonzero(np.diff(places) > 4 * max(DISTANCES)))
    peak = groups[0][int(np.argmax(deviations[groups[0]]))]
    many = f"{len(groups)} spikes, the first" if len(groups) > 1 else "a spike"
    where = f"at {series.time[places[peak]]:.4g} s ({deviations[peak] / series[name].std():.1f} standard deviations)"
    text = f"{name} has {many} {where}, which no other channel sees"
    return Finding(SPIKES, (name,), text, SPIKES.remedy)
