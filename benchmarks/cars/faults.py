"""Faults of records: each changes one channel, or swaps two."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift

from benchmarks.cars.rig import RATE

Array = NDArray[np.float64]
Channels = dict[str, Array]


def _swapped(first: str, second: str) -> Callable[[Channels], Channels]:
    return lambda channels: channels | {first: channels[second], second: channels[first]}


def _with(name: str, change: Callable[[Array], Array]) -> Callable[[Channels], Channels]:
    return lambda channels: channels | {name: change(channels[name])}


def _clipped(share: float) -> Callable[[Array], Array]:
    return lambda values: np.clip(values, *np.quantile(values, [0.5 * share, 1.0 - 0.5 * share]))


def _dead(values: Array) -> Array:
    generator = np.random.default_rng(50)
    return np.asarray(values.mean() + 0.01 * values.std() * generator.standard_normal(values.size))


def _late(milliseconds: float) -> Callable[[Array], Array]:
    return lambda values: np.asarray(shift(values, 1e-3 * milliseconds * RATE, order=3, mode="nearest"))


#: Changes of the channels of a record, by name, and the channels that are to be named.
FAULTS: dict[str, tuple[Callable[[Channels], Channels], tuple[str, ...]]] = {
    "ride heights swapped": (
        _swapped("front.ride_height", "rear.ride_height"),
        ("front.ride_height", "rear.ride_height"),
    ),
    "hubs swapped": (
        _swapped("lf.hub_acceleration", "rf.hub_acceleration"),
        ("lf.hub_acceleration", "rf.hub_acceleration"),
    ),
    "hub dead": (_with("rr.hub_acceleration", _dead), ("rr.hub_acceleration",)),
    "aero swapped": (_swapped("lf.aero", "lr.aero"), ("lf.aero", "lr.aero")),
    "aero swapped across": (_swapped("lr.aero", "rr.aero"), ("lr.aero", "rr.aero")),
    "potentiometer x 1.1": (_with("lf.displacement", lambda values: 1.1 * values), ("lf.displacement",)),
    "force clipped 1 %": (_with("rf.force", _clipped(0.01)), ("rf.force",)),
    "force clipped 3 %": (_with("rf.force", _clipped(0.03)), ("rf.force",)),
    "tire force clipped 3 %": (_with("lr.tire_force", _clipped(0.03)), ("lr.tire_force",)),
    "force late 3 ms": (_with("lf.force", _late(3.0)), ("lf.force",)),
    "tire force late 3 ms": (_with("rr.tire_force", _late(3.0)), ("rr.tire_force",)),
    "hub late 3 ms": (_with("rf.hub_acceleration", _late(3.0)), ("rf.hub_acceleration",)),
    "potentiometer late 3 ms": (_with("lr.displacement", _late(3.0)), ("lr.displacement",)),
    "chassis sign": (_with("lf.chassis_acceleration", lambda values: -values), ("lf.chassis_acceleration",)),
    "tire force x 1.2": (_with("lf.tire_force", lambda values: 1.2 * values), ("lf.tire_force",)),
    "force x 1.3": (_with("rr.force", lambda values: 1.3 * values), ("rr.force",)),
    "hub x 1.2": (_with("lr.hub_acceleration", lambda values: 1.2 * values), ("lr.hub_acceleration",)),
}


def faulted(channels: Channels, name: str) -> Channels:
    """Return the channels of a record with one of `FAULTS`."""
    return FAULTS[name][0](channels)
