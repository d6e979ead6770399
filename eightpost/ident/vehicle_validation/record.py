"""Rig records that a vehicle is compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eightpost.errors import MissingChannelError, ParameterError
from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.ident.vehicle_validation.kinds import Kind, Recognition, recognise

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.rig.post import RigConditions, RigTest
    from eightpost.signals import TimeSeries
    from eightpost.vehicle import StateSpace

#: Approximate rate of prepared records [Hz]: inputs that are linear over 1.6 ms lose 0.3 % at 20 Hz.
RATE = 625.0


@dataclass(frozen=True, slots=True, eq=False)
class RigRecord:
    """A prepared rig test that a vehicle is compared with.

    Attributes:
        name: Name of its file, or its number.
        kind: Kind of test.
        reason: Reason for the kind, as text.
        series: Channels at the simulation's rate, without means.
        means: Means by channel, SI.
        conditions: Conditions stated in the file.
        digest: SHA-256 of its file; empty without one.
        notes: Notes of the preparation, a sentence each; lags and drifts are reported for random records only.
        frequency: Frequency of a sine [Hz].
    """

    name: str
    kind: Kind
    reason: str
    series: TimeSeries
    means: Mapping[str, float]
    conditions: RigConditions
    digest: str
    notes: tuple[str, ...] = ()
    frequency: float | None = None


def record_of(test: RigTest, model: StateSpace, *, kind: Kind | None = None, name: str = "record") -> RigRecord:
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
    roads = [name for name in model.input_names if name.rpartition(".")[2] == "road"]
    loads = [n for n in model.input_names if n not in roads and n.rpartition(".")[2] != "force" and n in series]
    found = recognise(series, roads, loads)
    if kind == "sine" and found.frequency is None:
        raise ParameterError(f"{called}: --kind says that it is a sine, but {found.reason}; omit --kind")
    if kind is not None and kind != found.kind:
        found = Recognition(kind, "kind given by the user", found.frequency)
    return RigRecord(
        called,
        found.kind,
        found.reason,
        series,
        prepared.means[0],
        test.conditions,
        test.sha256,
        (*(prepared.notes if found.kind == "random" else ()), *_missing_loads(series, model, called)),
        found.frequency,
    )


def _check_channels(series: TimeSeries, model: StateSpace, test: RigTest, called: str) -> None:
    needed = [n for n in model.input_names if n.rpartition(".")[2] in ("road", "force")]
    ports = [n.removesuffix("force") for n in needed if n.rpartition(".")[2] == "force"]
    for name in (*needed, *(f"{port}velocity" for port in ports)):
        if name not in series:
            what = f"{called} lacks a channel that the vehicle {model.name!r} needs; is it a record of another car?"
            raise MissingChannelError(what, path=test.source, channel=name)


def _missing_loads(series: TimeSeries, model: StateSpace, called: str) -> tuple[str, ...]:
    lost = [name for name in model.input_names if name not in series]
    if not lost:
        return ()
    return (f"{called}: {', '.join(lost)} is an input of the vehicle but not in the record; assumed constant",)
