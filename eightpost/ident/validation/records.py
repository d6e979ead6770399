"""Records that models are validated on: dynamometer records of shocks and rig records of vehicles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, uniform_filter1d

from eightpost.array_types import Array
from eightpost.errors import InputError, MissingChannelError, ParameterError
from eightpost.files import document_kind
from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.ident.shock.result import digest_of
from eightpost.ident.shock.runs import refined_frequency, single_frequency
from eightpost.ident.vehicle.experiment import quantity
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.motion import displacement_of
from eightpost.rig.post import RigConditions, RigTest
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle import StateSpace

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
_RECORDS = {".csv", ".txt", ".parquet", ".mat", ".mf4", ".mdf"}


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
            "another car to compare modes with as --against CAR.json"
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
    """Return where a record stands still (N,): within 1/200 of its length it moves less than 1 % of its stroke.

    Args:
        series: `displacement` [m], or `velocity` [m/s] to integrate.
    """
    half = _half_window(series)
    # Means over a quarter of the window keep the sensor's noise from being taken for motion.
    smooth = uniform_filter1d(displacement_of(series), max(1, half // 2), mode="nearest")
    padded = np.pad(smooth, half, mode="edge")
    return np.asarray(np.abs(padded[2 * half :] - padded[: -2 * half]) < _STANDS * np.ptp(smooth))


def _half_window(series: TimeSeries) -> int:
    window = max(_WINDOW * series.duration, _SHORTEST_WINDOW)
    return max(1, round(0.5 * window * series.sample_rate))


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last sample of every run of true values of a mask (N,)."""
    labels, count = label(mask)
    starts = np.flatnonzero(np.diff(labels, prepend=0) > 0) if count else np.empty(0, int)
    ends = np.flatnonzero(np.diff(labels, append=0) < 0) if count else np.empty(0, int)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


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

    Args:
        test: Test with displacement; if displacement is missing, the velocity is integrated.
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
    """Return a record; its kind is recognised if it is not given.

    Args:
        test: Measured test.
        name: Display name; default the file's name.
        kind: Kind of the test, which replaces the recognised one.
    """
    seen = Recognition(kind, "given by the user") if kind else recognise_motion(test)
    return DynoRecord(
        name=name or (test.source.stem if test.source else "record"),
        kind=seen.kind,
        reason=seen.reason,
        frequency=seen.frequency,
        digest=digest_of(test),
        test=test,
    )


# ==== Rig records: their drive and kind of test ======================================================================

# ---- Recognition of the kind of test from the drive (6.1.3) ---------------------------------------------------------

#: Fraction of the road power within the relative width `_NEAR` of one frequency from which a record is a sine.
_PURE, _NEAR = 0.9, 0.2

#: An input is constant while it changes by less than this fraction of its range in `_LOOK` [s].
_STILL, _LOOK = 0.01, 0.05

#: Standard deviation of a road input below which it is at rest, above the noise of an LVDT [m].
_AT_REST = 1e-4


def recognise_drive(series: TimeSeries, roads: Sequence[str], loads: Sequence[str]) -> Recognition:
    """Recognise the kind of test of a record without means.

    The kinds are tried in this order: static, if no road moves and the loads are constant at least half of the time;
    sine, if 90 % of the roads' power lies within 20 % of one frequency; bump, if the roads are constant at least half
    of the time; otherwise random.

    Args:
        series: The record.
        roads: Names of its wheelloader channels.
        loads: Names of its aeroloaders, or of forces and moments on the chassis.
    """
    road = _rows(series, roads)
    if road.std(axis=1).max(initial=0.0) < _AT_REST:
        share = _standing(_rows(series, loads), series.sample_rate)
        if share >= STANDING:
            return Recognition("static", f"loads constant {100.0 * share:.0f} % of the time, roads at rest")
        return Recognition("random", "roads at rest, loads always moving")
    frequency, share = _one_frequency(road, series.sample_rate)
    if share >= _PURE:
        reason = f"{100.0 * share:.0f} % of the roads' power is near {frequency:.3g} Hz"
        return Recognition("sine", reason, frequency)
    share = _standing(road, series.sample_rate)
    if share >= STANDING:
        return Recognition("bump", f"roads constant {100.0 * share:.0f} % of the time, with steps between")
    return Recognition("random", "roads always moving, at many frequencies")


def _rows(series: TimeSeries, names: Sequence[str]) -> Array:
    return np.stack([series[name] for name in names]) if names else np.zeros((1, len(series)))


def _one_frequency(rows: Array, rate: float) -> tuple[float, float]:
    """Return the strongest frequency [Hz] and the fraction of the power near it."""
    power = np.sum(np.abs(np.fft.rfft(rows * np.hanning(rows.shape[1]), axis=1)) ** 2, axis=0)
    lines = np.fft.rfftfreq(rows.shape[1], 1.0 / rate)
    top = int(np.argmax(power[1:])) + 1
    about = slice(max(top - 2, 0), top + 3)  # the window's main lobe
    frequency = float(lines[about] @ power[about] / power[about].sum())
    width = max(_NEAR * frequency, 3.0 * lines[1])
    near = np.abs(lines - frequency) <= width
    return frequency, float(power[near].sum() / power.sum())


def _standing(rows: Array, rate: float) -> float:
    """Return the fraction of the time in which no row changes."""
    look = max(1, round(_LOOK * rate))
    span = np.ptp(rows, axis=1, keepdims=True)
    change = np.abs(rows[:, look:] - rows[:, :-look])
    return float(np.mean(np.all(change <= _STILL * span.max(), axis=0)))


# ---- Rig records that a vehicle is compared with --------------------------------------------------------------------

#: Approximate rate of prepared records [Hz]: inputs that are linear over 1.6 ms lose 0.3 % at 20 Hz.
RATE = 625.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigRecord(Record):
    """A prepared rig test that a vehicle is compared with."""

    series: TimeSeries  #: Channels at the simulation's rate, without means.
    means: Mapping[str, float]  #: Means by channel, SI.
    conditions: RigConditions  #: Conditions stated in the file.
    #: Notes of the preparation, a sentence each; lags and drifts are reported for random records only.
    notes: tuple[str, ...] = ()


def rig_record(test: RigTest, model: StateSpace, *, kind: Kind | None = None, name: str = "record") -> RigRecord:
    """Return a rig test prepared for a comparison with a vehicle.

    Args:
        test: Rig test.
        model: Vehicle that the record's channels will drive.
        kind: Kind of test; None recognises it from the drive.
        name: Name of the record if it has no file.

    Raises:
        MissingChannelError: A road, a shock force or a shock velocity is missing.
        ParameterError: The kind is sine, but the record has no dominant frequency.
        TooShortError: The record is too short.
    """
    called = test.source.name if test.source else name
    rate = test.series.sample_rate
    factor = max(1, round(rate / RATE)) if model.dt is None else max(1, round(rate * model.dt))
    prepared = prepare([test], Preparation(Decimation(rate / factor)))
    series = prepared.records[0]
    _check_channels(series, model, test, called)
    roads = [name for name in model.input_names if quantity(name) == "road"]
    loads = [n for n in model.input_names if n not in roads and quantity(n) != "force" and n in series]
    found = recognise_drive(series, roads, loads)
    if kind == "sine" and found.frequency is None:
        raise ParameterError(f"{called}: --kind says that it is a sine, but {found.reason}; omit --kind")
    if kind is not None and kind != found.kind:
        found = Recognition(kind, "kind given by the user", found.frequency)
    return RigRecord(
        name=called,
        kind=found.kind,
        reason=found.reason,
        frequency=found.frequency,
        digest=test.sha256,
        series=series,
        means=prepared.means[0],
        conditions=test.conditions,
        notes=(*(prepared.notes if found.kind == "random" else ()), *_missing_loads(series, model, called)),
    )


def _check_channels(series: TimeSeries, model: StateSpace, test: RigTest, called: str) -> None:
    needed = [n for n in model.input_names if quantity(n) in ("road", "force")]
    ports = [n.removesuffix("force") for n in needed if quantity(n) == "force"]
    for name in (*needed, *(f"{port}velocity" for port in ports)):
        if name not in series:
            what = f"{called} lacks a channel that the vehicle {model.name!r} needs; is it a record of another car?"
            raise MissingChannelError(what, path=test.source, channel=name)


def _missing_loads(series: TimeSeries, model: StateSpace, called: str) -> tuple[str, ...]:
    lost = [name for name in model.input_names if name not in series]
    if not lost:
        return ()
    return (f"{called}: {', '.join(lost)} is an input of the vehicle but not in the record; assumed constant",)
