"""Rig records that vehicles are validated on: their drive and kind of test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import MissingChannelError, ParameterError
from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.ident.validation.records import STANDING, Kind, Recognition, Record
from eightpost.ident.vehicle.experiment import quantity
from eightpost.rig.post import RigConditions, RigTest
from eightpost.signals import TimeSeries
from eightpost.vehicle import StateSpace

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
