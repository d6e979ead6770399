"""Simulated lightly damped structures drawn at random, with their exact frequency responses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, freqz, lfilter

from eightpost.signals import TimeSeries

RATE, DURATION, RUN_IN = 125.0, 60.0, 40.0
INPUTS, OUTPUTS = ("u1", "u2"), ("y1", "y2")


class Structure(NamedTuple):
    """Modes with shapes and damping ratios, and records of two tests with noise on the outputs."""

    damping: NDArray[np.float64]
    frequency: NDArray[np.float64]
    records: tuple[TimeSeries, ...]
    filters: tuple[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], ...]

    def truth(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the exact response (p, m, K)."""
        parts = [gain[..., None] * freqz(b, a, frequency, fs=RATE)[1] for b, a, gain in self.filters]
        return np.asarray(np.sum(parts, axis=0))


def structure(seed: int, noise: float = 0.01, damping: tuple[float, float] = (1e-3, 5e-2)) -> Structure:
    """Return a structure of five modes from 2 to 28 Hz, with damping ratios that are uniform in their logarithm."""
    generator = np.random.default_rng(seed)
    frequency = np.sort(generator.uniform(2.0, 28.0, 5))
    ratio = np.exp(generator.uniform(*np.log(damping), 5))
    filters = []
    for f, zeta in zip(frequency, ratio, strict=True):
        w = 2.0 * np.pi * f
        b, a, _ = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), 1.0 / RATE)
        filters.append((np.ravel(b), a, np.outer(*generator.standard_normal((2, 2)))))
    records = tuple(_record(filters, generator, noise) for _ in range(2))
    return Structure(ratio, frequency, records, tuple(filters))


def _record(filters: list[tuple], generator: np.random.Generator, noise: float) -> TimeSeries:  # type: ignore[type-arg]
    """Return a test with random inputs; it starts while the structure already moves."""
    u = generator.standard_normal((2, round((DURATION + RUN_IN) * RATE)))
    y = sum(gain @ lfilter(b, a, u, axis=1) for b, a, gain in filters)
    u, y = u[:, round(RUN_IN * RATE) :], np.asarray(y)[:, round(RUN_IN * RATE) :]
    y = y + noise * y.std(axis=1, keepdims=True) * generator.standard_normal(y.shape)
    names = zip((*INPUTS, *OUTPUTS), ("1", "1", "m/s2", "m/s2"), (*u, *y), strict=True)
    return TimeSeries.from_channels(np.arange(u.shape[1]) / RATE, {n: (unit, row) for n, unit, row in names})
