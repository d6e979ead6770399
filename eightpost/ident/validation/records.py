"""Records that models are validated on, their kinds of tests and their motion, and spectra of errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.files import document_kind
from eightpost.ident.shock.result import digest_of
from eightpost.ident.shock.runs import refined_frequency, single_frequency
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.motion import displacement_of
from eightpost.signals import TimeSeries
from eightpost.units import convert

# ==== Kinds of tests =================================================================================================

Kind = Literal["random", "sine", "static", "bump"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: Share of the time at standstill from which a record is a static test or a bump.
STANDING = 0.5


@dataclass(frozen=True, slots=True)
class Recognition:
    """Kind of a record, with the reason for it."""

    kind: Kind  #: `random` (track records too), `sine`, `static` or `bump`.
    reason: str  #: Property of the motion or of the drive that led to this kind.
    frequency: float | None = None  #: Frequency of a sine [Hz]; None for the other kinds.


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Record:
    """A record for validation."""

    name: str  #: Display name.
    kind: Kind  #: Kind of the test.
    reason: str  #: Reason for the kind.
    frequency: float | None = None  #: Frequency of a sine [Hz], if it was recognised as one.
    digest: str  #: SHA-256 of the file, or of the samples; empty without one.


# ---- Files of models and of records ---------------------------------------------------------------------------------

#: Suffixes of the records that are read from a folder.
_RECORDS = {".csv", ".txt", ".parquet", ".mat", ".mf4", ".mdf", ".rsp", ".rpc", ".ld"}


def models_and_records(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Return the models (.json) and the records among paths, with the records of folders.

    Raises:
        InputError: There is no model, or no record.
    """
    models: list[Path] = []
    records: list[Path] = []
    for path in paths:
        if path.is_dir():
            records += sorted(file for file in path.iterdir() if file.suffix.lower() in _RECORDS)
        elif path.suffix.lower() == ".json":
            models.append(path)
        else:
            records.append(path)
    if not models:
        raise InputError(
            "no shock file and no vehicle among the arguments; create one with `eightpost fit DYNO -o shock.json` or "
            "`eightpost identify RIG -o vehicle.json`"
        )
    if not records:
        raise InputError("no record among the arguments; name dynamometer or rig files, or a folder of them")
    return models, records


def is_vehicle(models: list[Path]) -> bool:
    """Return whether the models are vehicles, by the kind that the files state.

    Raises:
        InputError: There are both shocks and vehicles, or several vehicles.
    """
    vehicles = [path for path in models if document_kind(path) == "vehicle"]
    if vehicles and len(models) > 1:
        raise InputError(
            f"{vehicles[0]} is a vehicle: validate it alone; give shocks at its ports as --shock lf=SHOCK.json, and "
            "another car to compare modes with as --set against=CAR.json"
        )
    return bool(vehicles)


# ==== Dynamometer records: their motion and kind of test =============================================================

Mask = NDArray[np.bool_]

# ---- Analysis of a record's motion ----------------------------------------------------------------------------------

#: A record stands still where its displacement changes by less than this share of its stroke within a window.
_STANDS = 0.01

#: Length of the window as a share of the record, and its minimum [s].
_WINDOW, _SHORTEST_WINDOW = 1.0 / 200.0, 0.05


def standing(series: TimeSeries) -> Mask:
    """Return where a record stands still (N,): within 1/200 of its length it moves less than 1 % of its stroke."""
    half = _half_window(series)
    # Means over a quarter of the window keep the sensor's noise from being taken for motion.
    smooth = uniform_filter1d(displacement_of(series), max(1, half // 2), mode="nearest")
    padded = np.pad(smooth, half, mode="edge")
    return np.asarray(np.abs(padded[2 * half :] - padded[: -2 * half]) < _STANDS * np.ptp(smooth))


def _half_window(series: TimeSeries) -> int:
    window = max(_WINDOW * series.duration, _SHORTEST_WINDOW)
    return max(1, round(0.5 * window * series.sample_rate))


def moving_part(series: TimeSeries) -> TimeSeries:
    """Return a record without standstill at its beginning and end."""
    moves, half = np.flatnonzero(~standing(series)), _half_window(series)
    if moves.size < 3:
        return series
    first, last = int(moves[0]), int(moves[-1])
    # Anything within half a window of a motion counts as moving.
    first, last = first + half * (first > half), last - half * (last < len(series) - 1 - half)
    return series if last - first < half else series.window(float(series.time[first]), float(series.time[last]))


# ---- Recognition of the kind of test from the motion (3.2.3) --------------------------------------------------------

#: Minimum number of periods for a record with one frequency to be a sine test.
_PERIODS = 1.8

#: Limit between the dissertation's static test (0.2 in/s) and its bump (30 in/s) [m/s].
SLOW = convert(1.0, "in/s", "m/s")

#: Maximum number of samples used for the recognition.
_ENOUGH = 40_000


def recognise_motion(test: DynoTest) -> Recognition:
    """Return the kind of test of a record.

    The rules are applied in this order:

    1. sine: in its part between the first and the last motion, at least 1.8 periods, and 90 % of the velocity's power
       within 20 % of one frequency;
    2. static: it stands still at least half of the time and is never faster than 1 in/s (Fig 3.12: 0.2 in/s);
    3. bump: it stands still at least half of the time and is faster (Fig 3.13: 30 in/s);
    4. random: everything else, including track records.
    """
    series = _coarse(test.series)
    frequency = frequency_of(series)
    if frequency is not None:
        return Recognition("sine", f"one frequency, {frequency:.4g} Hz", frequency)
    share = float(np.mean(standing(series)))
    if share < STANDING:
        return Recognition("random", f"moves {100.0 * (1.0 - share):.0f} % of the time, at many frequencies")
    speed = _speed(series)
    stands = f"stands still {100.0 * share:.0f} % of the time, moves at up to {convert(speed, 'm/s', 'in/s'):.2g} in/s"
    return Recognition("static" if speed < SLOW else "bump", stands)


def frequency_of(series: TimeSeries) -> float | None:
    """Return the frequency [Hz] of a record that is a sine, else None."""
    part = moving_part(series)
    coarse = single_frequency(part["velocity"], part.sample_rate)
    if coarse is None or coarse * part.duration < _PERIODS:
        return None
    if coarse * part.duration > 3.0:  # the first and last half period may include standstill
        part = part.window(float(part.time[0]) + 0.5 / coarse, float(part.time[-1]) - 0.5 / coarse)
    return refined_frequency(displacement_of(part), part.time, coarse)


def _coarse(series: TimeSeries) -> TimeSeries:
    """Return a long record averaged over blocks of samples; the rate stays at 200 Hz or more."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    count = min(len(even) // _ENOUGH + 1, max(1, int(even.sample_rate // 200.0)))
    return block_means(even, count)


def block_means(series: TimeSeries, count: int) -> TimeSeries:
    """Return the means of every `count` samples, at the mean of their times."""
    if count < 2:
        return series
    whole = len(series) // count * count
    values = series.values[:, :whole].reshape(len(series.names), -1, count).mean(axis=2)
    time = series.time[:whole].reshape(-1, count).mean(axis=1)
    return type(series)(time, values, series.names, series.units)


def _speed(series: TimeSeries) -> float:
    """Return the peak speed [m/s] of means over 5 ms, so that noise of the velocity sensor has no effect."""
    count = max(1, int(0.005 * series.sample_rate))
    return float(np.abs(block_means(series, count)["velocity"]).max())


# ---- A dynamometer record with its kind -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DynoRecord(Record):
    """A dynamometer record."""

    test: DynoTest  #: Measured test.

    @property
    def conditions(self) -> Mapping[str, Any]:
        """The known conditions of the shock in the record, under the names of a shock file."""
        known = self.test.conditions
        stated = {"build": known.build, "clicks": known.clicks, "gas_pressure [Pa]": known.gas_pressure}
        return {name: value for name, value in stated.items() if value is not None}


def dyno_record(test: DynoTest, *, name: str | None = None, kind: Kind | None = None) -> DynoRecord:
    """Return a record; its kind is recognised if it is not given."""
    seen = Recognition(kind, "given by the user") if kind else recognise_motion(test)
    return DynoRecord(
        name=name or (test.source.stem if test.source else "record"),
        kind=seen.kind,
        reason=seen.reason,
        frequency=seen.frequency,
        digest=digest_of(test),
        test=test,
    )


# ==== Spectra of a prediction's error, and the part of the error that is linear in another signal ====================


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an error e = measured minus predicted, and its coherence with a signal v.

        coherence(f) = |S_ev|^2 / (S_ee S_vv)

    Where the coherence is near 1, a linear filter of the signal would predict the error. A coherence below `threshold`
    is not significant.
    """

    frequency: Array  #: Frequencies (K,) [Hz].
    coherence: Array  #: Coherence (K,) [1].
    error: Array  #: One-sided power spectral density of the error (K,) [unit^2/Hz].
    measured: Array  #: One-sided power spectral density of the measured signal (K,) [unit^2/Hz].
    threshold: float  #: Value that the coherence of unrelated signals exceeds at 5 % of the frequencies [1].
    share: float  #: Share of the error's power that is coherent, corrected for the bias of the estimate [1].


def error_spectrum(
    measured: Array, predicted: Array, signal: Array, *, rate: float, band: float, block: float, fewest: int,
    overlap: float = 0.0,
) -> ErrorSpectrum | None:  # fmt: skip
    """Return the spectra of an error by Welch's method; None if the record is too short for them.

    Args:
        measured: Measured values (N,).
        predicted: Predicted values (N,).
        signal: Signal (N,) that the error may be coherent with.
        rate: Sample rate [Hz].
        band: Highest frequency [Hz].
        block: Length of the blocks [s], which overlap by half.
        fewest: Minimum number of blocks for a meaningful coherence.
        overlap: Correlation of the periodograms of overlapping blocks [1].
    """
    from scipy.signal import coherence, welch  # noqa: PLC0415 -- takes half a second to load, which no fit needs

    size = round(block * rate)
    count = 2 * measured.size // size - 1
    if count < fewest:
        return None
    error = measured - predicted
    frequency, coherent = coherence(error, signal, fs=rate, nperseg=size)
    _, density = welch(error, fs=rate, nperseg=size)
    _, whole = welch(measured, fs=rate, nperseg=size)
    kept = (frequency > 0.0) & (frequency <= band)
    averages = count / (1.0 + 2.0 * overlap * (count - 1) / count)
    # For n averages, unrelated signals have a coherence of 1 / n.
    unbiased = np.clip((averages * coherent[kept] - 1.0) / (averages - 1.0), 0.0, 1.0)
    total = float(density[kept].sum())
    return ErrorSpectrum(
        frequency=frequency[kept],
        coherence=coherent[kept],
        error=density[kept],
        measured=whole[kept],
        threshold=1.0 - 0.05 ** (1.0 / (averages - 1.0)),
        share=float(unbiased @ density[kept]) / total if total > 0.0 else 0.0,
    )
