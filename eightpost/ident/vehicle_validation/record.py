"""A rig test, ready to hold a vehicle against."""

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

#: Rate that records are brought to [Hz], about: inputs that are linear over 1.6 ms lose 0.3 % at 20 Hz.
RATE = 625.0


@dataclass(frozen=True, slots=True, eq=False)
class RigRecord:
    """A rig test, ready to hold a vehicle against.

    Attributes:
        name: Of its file, or its number.
        kind: What test it is.
        reason: What told so.
        series: At the simulation's rate, without means.
        means: By channel, SI.
        conditions: As the file says.
        digest: SHA-256 of its file; empty without one.
        notes: What its preparation found, a sentence each: lags and drifts are told from random records only.
        frequency: Of a sine [Hz].
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
    """Return a rig test as a vehicle is held against it.

    Args:
        test: As read.
        model: Whose inputs drive it.
        kind: What test it is; None tells it by what drives it.
        name: Where it has no file.

    Raises:
        MissingChannelError: A road, a shock's force or its velocity is not in it.
        TooShortError: Next to nothing is left of it.
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
        raise ParameterError(f"{called}: it is said to be a sine, but {found.reason}; leave --kind away")
    if kind is not None and kind != found.kind:
        found = Recognition(kind, "was said to be one", found.frequency)
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
            what = f"{called} has no such channel, which the vehicle {model.name!r} is driven by; is it of another car?"
            raise MissingChannelError(what, path=test.source, channel=name)


def _missing_loads(series: TimeSeries, model: StateSpace, called: str) -> tuple[str, ...]:
    lost = [name for name in model.input_names if name not in series]
    if not lost:
        return ()
    return (f"{called}: {', '.join(lost)} is an input of the vehicle and not in the record; taken as constant",)
