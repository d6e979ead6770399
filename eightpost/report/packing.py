"""Time series in a page: traces without loss of peaks, power spectral densities, and their numbers as text."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from eightpost.array_types import Array
from eightpost.report.page import compressed
from eightpost.report.series import Series

# ---- Encoding of arrays as text in a page ---------------------------------------------------------------------------

#: Number of levels between the minimum and the maximum of a channel: 16 bits are 100 times finer than a screen.
LEVELS = 65535


@dataclass
class Store:
    """Arrays in one block of bytes, each identified by its start position."""

    _content: bytearray = field(default_factory=bytearray)

    def add(self, values: Array) -> int:
        """Add numbers in full (little-endian, 64 bits) and return their start position."""
        return self._append(values.astype("<f8").tobytes())

    def add_single(self, values: Array) -> int:
        """Add numbers to seven digits (little-endian, 32 bits) and return their start position."""
        return self._append(values.astype("<f4").tobytes())

    def add_levels(self, values: Array) -> int:
        """Add (M,) values as 16-bit levels between their minimum and maximum, and return their start position.

        Each level is stored as its difference from the one before, modulo 2^16: a smooth signal compresses well.
        """
        low, high = float(values.min()), float(values.max())
        levels = np.rint((values - low) * (LEVELS / (high - low))) if high > low else np.zeros_like(values)
        differences = np.diff(levels.astype("<u2"), prepend=np.uint16(0))
        return self._append(differences.astype("<u2").tobytes())

    @property
    def text(self) -> str:
        """Contents as text for a page."""
        return compressed(bytes(self._content))

    def _append(self, content: bytes) -> int:
        self._content.extend(b"\0" * (-len(self._content) % 8))  # a browser reads doubles at multiples of eight only
        place = len(self._content)
        self._content.extend(content)
        return place


# ---- Power spectral densities ---------------------------------------------------------------------------------------

#: Length of a block [s]: a resolution of 0.25 Hz, and 14 blocks, half overlapping, in 30 s.
BLOCK = 4.0

#: Maximum number of values over all channels of a page; blocks are shortened to stay below it.
CAPACITY = 1_000_000

#: Minimum number of samples for a spectrum.
_FEWEST = 16


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """One-sided power spectral densities."""

    frequency: Array  #: Frequencies (K,) above zero [Hz].
    density: Array  #: Densities (C, K) in the SI unit squared per Hz; the integral over frequency is the variance.
    block: float  #: Length of a block [s].
    duration: float  #: Length of the series [s].


def spectra(series: Series) -> Spectra | None:
    """Estimate densities by Welch's method: Hann blocks of 4 s, half overlapping, each without its mean.

    Blocks are shorter in a shorter series, and if there are so many channels that a page could not hold their
    densities. A series with uneven steps is interpolated to its median rate first.

    Returns:
        Densities; None if there are too few samples or no channels.
    """
    if len(series) < _FEWEST or not series.names:
        return None
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    length = min(len(even), round(BLOCK * rate), max(_FEWEST, 2 * CAPACITY // len(even.names)))
    if length < _FEWEST:
        return None
    frequency, density = welch(even.values, rate, length)
    return Spectra(frequency[1:], density[:, 1:], block=length / rate, duration=even.duration)


def welch(values: Array, rate: float, length: int) -> tuple[Array, Array]:
    """Return frequencies (K,) [Hz] and one-sided densities (..., K) of samples (..., N), by Welch's method.

    Hann blocks of `length` samples, half overlapping, each without its mean. They agree with those of scipy.signal to
    rounding, which takes most of a second to load.
    """
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    blocks = np.lib.stride_tricks.sliding_window_view(values, length, axis=-1)[..., :: length - length // 2, :]
    lines = np.fft.rfft(window * (blocks - blocks.mean(axis=-1, keepdims=True)))
    density: Array = (np.abs(lines) ** 2).mean(axis=-2) / (rate * np.sum(window**2))
    density[..., 1 : (length + 1) // 2] *= 2.0
    return np.arange(length // 2 + 1, dtype=np.float64) * (rate / length), density


# ---- Decimation of time traces for a page, without loss of peaks ----------------------------------------------------

#: Maximum number of values over all channels of a page: 40 channels of 60 s at 2 ms fit, in about 3 MB.
TRACES_CAPACITY = 1_250_000


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Traces that the page draws."""

    time: Array  #: Times (M,) [s].
    values: Array  #: Values (C, M) in SI.
    samples: int  #: Number of recorded samples per pair of values; 1 if all are kept.
    interval: float  #: Time span of these samples [s].


def traces(series: Series, *, capacity: int = TRACES_CAPACITY) -> Traces:
    """Keep all samples if they fit, else the minimum and the maximum of every few, in their order.

    With n samples per pair, the times of each pair are those of the first and the middle of the n samples, so the time
    of a value is wrong by less than n samples.

    Args:
        series: Recorded series with C channels.
        capacity: Maximum number of values to keep, over all channels; at least two per channel are kept.
    """
    length, channels = len(series), max(1, len(series.names))
    pairs = max(1, capacity // (2 * channels))
    if length <= 2 * pairs:
        return Traces(series.time, series.values, samples=1, interval=series.duration / max(1, length - 1))
    samples = -(-length // pairs)
    starts = np.arange(0, length, samples)
    middles = np.minimum(starts + samples // 2, length - 1)
    time = series.time[np.column_stack([starts, middles]).ravel()]
    return Traces(time, _pairs(series.values, samples), samples, interval=samples * series.duration / (length - 1))


def _pairs(values: Array, samples: int) -> Array:
    """Return (C, 2 K): minimum and maximum of every `samples` values, in the order in which they occurred."""
    channels, length = values.shape
    missing = -length % samples
    bins = np.pad(values, ((0, 0), (0, missing)), mode="edge").reshape(channels, -1, samples)
    ends = np.sort(np.stack([bins.argmin(axis=2), bins.argmax(axis=2)], axis=2), axis=2)
    pairs: Array = np.take_along_axis(bins, ends, axis=2).reshape(channels, -1)
    return pairs
