"""Records in blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import get_window

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.errors import DataError, InputError, ParameterError, TooShortError
from eightpost.signals import TimeSeries
from eightpost.vehicle.statespace import Channel

# ---- Windowed, overlapping blocks and their spectra -----------------------------------------------------------------


class Spectra(NamedTuple):
    """Spectra of all blocks of all tests."""

    frequency: Array  #: Frequencies (K,) [Hz].
    U: Complex  #: Spectra of the inputs (K, R, m).
    Y: Complex  #: Spectra of the outputs (K, R, p).
    test: NDArray[np.intp]  #: Index of the test that each block belongs to (R,).
    independent: float  #: Number of independent blocks that is equivalent to the R overlapping ones.


@dataclass(frozen=True, slots=True)
class Blocks:
    """Division of records into blocks."""

    #: Length of a block [s]; the frequencies are 1 / length apart. Short blocks have leakage: if a mode rings for as
    #: long as the block lasts, its peak is smeared and its damping ratio is estimated too large.
    length: float
    window: str = "hann"  #: Window, any of `scipy.signal.get_window`; the dissertation uses "hamming".
    overlap: float = 0.5  #: Overlap of neighbouring blocks [1].
    high: float = 30.0  #: Highest frequency [Hz]; the lowest one is 1 / length.

    def __post_init__(self) -> None:
        if not (self.length > 0.0 and 0.0 <= self.overlap < 1.0 and self.high > 0.0):
            raise ParameterError(f"{self}: length and high must be above zero, overlap from 0 to below 1")

    def spectra(self, records: Records) -> Spectra:
        """Return the spectra of the blocks of all records; TooShortError: a record is shorter than a block."""
        size = max(2, round(self.length * records.rate))
        frequency: Array = np.arange(size // 2 + 1, dtype=np.float64) * (records.rate / size)
        kept = np.flatnonzero((frequency > 0.0) & (frequency <= min(self.high, 0.499 * records.rate)))
        window = np.asarray(get_window(self.window, size), dtype=np.float64)
        hop = max(1, round(size * (1.0 - self.overlap)))
        U, Y, test = [], [], []
        for number, (u, y) in enumerate(records.tests):
            if u.shape[1] < size:
                raise TooShortError(
                    f"record {number + 1} has {u.shape[1]} samples, but a block of {self.length:g} s has {size}; use "
                    "shorter blocks"
                )
            starts = range(0, u.shape[1] - size + 1, hop)
            U += [np.fft.rfft(window * u[:, k : k + size])[:, kept] for k in starts]
            Y += [np.fft.rfft(window * y[:, k : k + size])[:, kept] for k in starts]
            test += [number] * len(starts)
        worth = len(test) / _repetition(window, hop, len(test))
        chosen: Array = frequency[kept]
        return Spectra(chosen, _by_frequency(U), _by_frequency(Y), np.array(test, dtype=np.intp), worth)


def _by_frequency(spectra: list[Complex]) -> Complex:
    return np.ascontiguousarray(np.stack(spectra).transpose(2, 0, 1))


def _repetition(window: Array, hop: int, count: int) -> float:
    """Return the ratio of the variances of a mean over overlapping blocks and over separate blocks (Welch)."""
    total, energy = 1.0, float(window @ window)
    for k in range(1, min(count, (window.size - 1) // hop + 1)):
        shared = float(window[k * hop :] @ window[: window.size - k * hop]) / energy
        total += 2.0 * (1.0 - k / count) * shared**2
    return total


# ---- Records of rig tests for estimators ----------------------------------------------------------------------------

#: Relative tolerance between the rates of two records, because loggers round time.
_RATE_TOLERANCE = 1e-3

_FEWEST_SAMPLES = 16


class Record(NamedTuple):
    """One test: inputs (m, N) and outputs (p, N), without means."""

    u: Array
    y: Array


@dataclass(frozen=True, slots=True, eq=False)
class Records:
    """Tests of one vehicle."""

    tests: tuple[Record, ...]  #: One or more tests.
    rate: float  #: Sample rate of all tests [Hz].
    inputs: tuple[Channel, ...]  #: Input channels.
    outputs: tuple[Channel, ...]  #: Output channels.


def gather(
    series: Sequence[TimeSeries],
    inputs: Sequence[str],
    outputs: Sequence[str],
    damping: Mapping[str, float] | None = None,
) -> Records:
    """Collect the channels of several records and remove their means.

    From the force of each port with a `damping` [N.s/m] ("lf", ...; "" is the port of a quarter car), the diagonal of
    C-bar, `c v` is subtracted (Eq 4.24, 5.36, 6.4).

    Raises:
        InputError: There is no record or no channel, or the rates differ.
        DataError: A record is not evenly sampled, or one of its channels has another unit than in the first record.
        TooShortError: A record has too few samples.
        MissingChannelError: A record lacks a channel.
    """
    if not series or not inputs or not outputs:
        raise InputError("a frequency response needs at least one record, one input and one output")
    rates = {channel(port, "force"): (channel(port, "velocity"), c) for port, c in (damping or {}).items()}
    for force in rates:
        if force not in inputs:
            raise InputError(f"a baseline damping is given for {force!r}, which is not an input")
    first = series[0]
    for number, record in enumerate(series, start=1):
        if len(record) < _FEWEST_SAMPLES:
            raise TooShortError(
                f"record {number} has {len(record)} samples; a response needs {_FEWEST_SAMPLES} or more"
            )
        if not record.is_uniform:
            raise DataError(f"record {number} is not evenly sampled; resample it first")
        if abs(record.sample_rate / first.sample_rate - 1.0) > _RATE_TOLERANCE:
            both = f"{record.sample_rate:g} Hz, the first {first.sample_rate:g} Hz"
            raise InputError(f"record {number} has {both}; resample to one rate")
        for name in (*inputs, *outputs):
            if record.unit(name) != first.unit(name):
                what = (
                    f"its unit is {record.unit(name)!r} in record {number}, but {first.unit(name)!r} in the first one"
                )
                raise DataError(what, channel=name)
    tests = tuple(Record(_centred(record, inputs, rates), _centred(record, outputs, {})) for record in series)
    channels = (tuple(Channel(name, first.unit(name)) for name in names) for names in (inputs, outputs))
    return Records(tests, first.sample_rate, *channels)


def _centred(record: TimeSeries, names: Sequence[str], rates: Mapping[str, tuple[str, float]]) -> Array:
    """Return channels (len(names), N) without means; they are copied only once, because they may be large."""
    values = np.empty((len(names), len(record)))
    for i, name in enumerate(names):
        values[i] = record[name]
        if name in rates:
            velocity, rate = rates[name]
            values[i] -= rate * record[velocity]
        values[i] -= values[i].mean()
    return values
