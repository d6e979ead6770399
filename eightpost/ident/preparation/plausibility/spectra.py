"""Short-time spectra of a rig record, from which the laws of the car are estimated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eightpost.corners import CORNERS, channel
from eightpost.signals.timeseries import TimeSeries

Spectrum = NDArray[np.complex128]

#: Length of a segment [s]; segments overlap by half.
SEGMENT = 4.0
#: Largest number of segments; they are spread over the record, so that the cost does not grow with its length.
MOST = 60
#: Smallest number of segments; shorter records are not checked.
FEWEST = 6
#: Band of all comparisons [Hz], at most `HIGHEST` of the sample rate: above, central differences are 4 % low.
BAND = (0.7, 15.0)
HIGHEST = 0.08

#: Quantity with the direction of a shock's velocity, on which friction depends, ...
DIRECTION = "direction"
#: ... that of the difference of the velocities left and right, on which friction in an anti-roll bar depends, with the
#: left corner as its prefix, ...
TWIST_DIRECTION = "twist_direction"
#: ... and velocity of the transition between the directions [m/s].
SLOW = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Spectra of the channels of a record, with the corrections that a search for faults applies."""

    frequencies: NDArray[np.float64]  #: Frequencies f (F,) [Hz].
    rows: Mapping[str, Spectrum]  #: Spectra (S, F) of S segments by channel.
    left_out: frozenset[str] = frozenset()  #: Names of channels of the record that must not be used.

    def __contains__(self, name: str) -> bool:
        """Return whether a channel is known."""
        return name in self.rows

    def has(self, names: Iterable[str]) -> bool:
        """Return whether all channels are known."""
        return all(name in self.rows for name in names)

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(next(iter(self.rows.values())))

    def derivative(self, name: str, order: int = 0) -> Spectrum:
        """Return the spectra (S, F) of a channel's derivative of a given order."""
        return self.rows[name] if order == 0 else self.rows[name] * (2j * np.pi * self.frequencies) ** order

    def corrected(self, names: Iterable[str], *, gain: float = 1.0, delay: float = 0.0) -> Spectra:
        """Return the spectra with channels divided by a gain and advanced by a delay [s]."""
        factor = np.exp(2j * np.pi * self.frequencies * delay) / gain
        return replace(self, rows={**self.rows, **{name: self.rows[name] * factor for name in names}})

    def without(self, names: Iterable[str]) -> Spectra:
        """Return the spectra without some channels."""
        left_out = self.left_out | set(names)
        rows = {name: row for name, row in self.rows.items() if name not in left_out}
        return replace(self, rows=rows, left_out=left_out)


def spectra_of(series: TimeSeries) -> Spectra | None:
    """Return the spectra of a record; None if it is too short."""
    rate = series.sample_rate
    size = round(SEGMENT * rate)
    starts = np.arange(0, len(series) - size + 1, max(1, size // 2))
    if starts.size < FEWEST:
        return None
    if starts.size > MOST:
        starts = starts[np.linspace(0, starts.size - 1, MOST).astype(int)]
    lines = np.fft.rfftfreq(size, 1.0 / rate)
    used = (lines >= BAND[0]) & (lines <= min(BAND[1], HIGHEST * rate))
    window = np.hanning(size)

    def segments(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([values[start : start + size] for start in starts])

    def transformed(cut: NDArray[np.float64]) -> Spectrum:
        return np.asarray(np.fft.rfft(window * cut, axis=1)[:, used])

    rows = {}
    for name, values in zip(series.names, series.values, strict=True):
        cut = segments(values)
        rows[name] = transformed(cut - cut.mean(axis=1, keepdims=True))
    for name, velocity in _velocities(series).items():
        rows[name] = transformed(np.tanh(segments(velocity) / SLOW))
    return Spectra(np.asarray(lines[used], dtype=np.float64), rows)


def _velocities(series: TimeSeries) -> dict[str, NDArray[np.float64]]:
    """Return the velocities (N,) on which friction depends, by the channel of their direction."""
    own = [name for name in series.names if name.rpartition(".")[2] == "velocity"]
    found = {f"{name.removesuffix('velocity')}{DIRECTION}": series[name] for name in own}
    for left, right in (CORNERS[:2], CORNERS[2:]):
        names = [channel(corner, "velocity") for corner in (left, right)]
        if all(name in own for name in names):
            found[channel(left, TWIST_DIRECTION)] = series[names[0]] - series[names[1]]
    return found
