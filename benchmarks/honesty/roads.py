"""Random drives: roads and loads, linear between points with even or uneven spacing."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.honesty.shocks import Random, log_uniform

Array = NDArray[np.float64]


def draw_times(random: Random, kind: str, end: float) -> Array:
    """Return the points (N,) of a drive from 0 to at least `end` [s]; closely spaced for roads that need it."""
    if kind != "white" and random.random() < 0.15:  # uneven spacing
        steps = np.exp(random.uniform(np.log(2e-4), np.log(1e-2), size=int(end / 2e-4)))
        times = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(times[: int(np.searchsorted(times, end)) + 1])
    low, high = {"white": (200.0, 5000.0), "spikes": (500.0, 5000.0)}.get(kind, (100.0, 2000.0))
    step = 1.0 / (5000.0 if kind == "white" and random.random() < 0.2 else log_uniform(random, low, high))
    return np.asarray(step * np.arange(int(np.ceil(end / step)) + 1))


def multisine(random: Random, time: Array) -> Array:
    """Return twelve sines of 0.5 to 40 Hz with road velocities of 0.03 to 0.4 m/s."""
    rates = np.exp(random.uniform(np.log(0.5), np.log(40.0), size=12))
    phases = random.uniform(0.0, 2.0 * np.pi, size=12)
    power = random.uniform(0.8, 1.6)
    row = np.asarray(np.sin(2.0 * np.pi * np.outer(time, rates) + phases) @ rates**-power)
    return row * log_uniform(random, 0.03, 0.4) / _speed(time, row)


def bumps(random: Random, time: Array) -> Array:
    """Return a few smooth bumps, each up to 40 mm high."""
    row = np.zeros_like(time)
    for _ in range(int(random.integers(2, 6))):
        length, middle = log_uniform(random, 0.015, 0.3), random.uniform(0.05, time[-1])
        inside = np.clip((time - middle) / length, -0.5, 0.5)
        row += log_uniform(random, 0.003, 0.04) * random.choice([-1.0, 1.0]) * np.cos(np.pi * inside) ** 2
    return row


def steps(random: Random, time: Array) -> Array:
    """Return steps of up to 20 mm from one point to the next."""
    row = np.zeros_like(time)
    for _ in range(int(random.integers(2, 7))):
        first = int(random.integers(1, time.size))
        row[first:] += log_uniform(random, 0.002, 0.02) * random.choice([-1.0, 1.0])
    return row


def chirp(random: Random, time: Array) -> Array:
    """Return a sine sweep from 0.5 Hz to at most 60 Hz with constant road velocity."""
    first, last = 0.5, random.uniform(15.0, 60.0)
    growth = np.log(last / first) / time[-1]
    phase = 2.0 * np.pi * first * np.expm1(growth * time) / growth
    return log_uniform(random, 0.05, 0.4) / (2.0 * np.pi * first * np.exp(growth * time)) * np.sin(phase)


def white(random: Random, time: Array) -> Array:
    """Return a random height at every point."""
    return log_uniform(random, 5e-5, 1e-3) * random.standard_normal(time.size)


def spikes(random: Random, time: Array) -> Array:
    """Return a few single points far from the others."""
    row = np.zeros_like(time) if random.random() < 0.7 else multisine(random, time)
    for place in random.integers(1, time.size, size=int(random.integers(2, 7))):
        row[place] += log_uniform(random, 0.001, 0.02) * random.choice([-1.0, 1.0])
    return row


def zeros(_: Random, time: Array) -> Array:
    """Return a flat road."""
    return np.zeros_like(time)


ROADS: Mapping[str, Callable[[Random, Array], Array]] = {
    "multisine": multisine,
    "bumps": bumps,
    "steps": steps,
    "chirp": chirp,
    "white": white,
    "spikes": spikes,
    "zeros": zeros,
}


def draw_load(random: Random, time: Array, size: float) -> Array:
    """Return a load of up to about `size`, in its unit."""
    rates = np.exp(random.uniform(np.log(0.5), np.log(20.0), size=4))
    return np.asarray(size * np.mean(np.sin(2.0 * np.pi * np.outer(time, rates) + rates), axis=1))


def _speed(time: Array, row: Array) -> float:
    """Return the root mean square of the slope between points."""
    return float(np.sqrt(np.mean((np.diff(row) / np.diff(time)) ** 2)))
