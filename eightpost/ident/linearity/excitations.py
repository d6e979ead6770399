"""Detection of inputs that move alone in a test (6.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.preparation import Prepared
from eightpost.signals import TimeSeries
from eightpost.vehicle.statespace import Channel

#: An actuator is at rest below this fraction of the largest of its kind in the same test [1] ...
RESTING = 0.2
#: ... or below this fraction of the largest of its kind in any test [1].
SMALLEST = 0.03

#: A command below this fraction of the actuator's motion is ignored [1].
COMMANDED = 0.01

#: A channel is white noise if its steps exceed this multiple of its size; exactly white noise has 1.41 [1].
WHITE = 1.2

#: Drives of two tests are equal if they differ by less than this fraction of their size [1].
SAME_DRIVE = 0.1

#: A change of the force difference below this fraction of the force is run-to-run variation [1].
REPEATED = 0.1

#: A shock is unchanged if its change of force is below this fraction of the largest change [1].
UNCHANGED = 0.5

_LOADS = ("aero_force", "heave_force", "roll_moment", "pitch_moment")


class Excitation(NamedTuple):
    """Input that moves alone, with the outputs."""

    test: str  #: Name of the test.
    channel: Channel  #: Input channel.
    u: Array  #: Input (N,).
    y: Array  #: Outputs (p, N).
    outputs: tuple[Channel, ...]  #: Output channels.
    rate: float  #: Sample rate [Hz].


class _ExcitationList(NamedTuple):
    """Excitations, with notes on the tests that are omitted."""

    excitations: tuple[Excitation, ...]
    notes: tuple[str, ...]


def excitations(prepared: Prepared, outputs: Sequence[str]) -> _ExcitationList:
    """Return an excitation for every input that moves alone.

    A test in which one actuator moves is used directly. If a test has the drive of an earlier one and another shock at
    one corner, the input is that shock's change of force and the outputs are their changes (4.24 to 4.26).

    Args:
        prepared: Prepared records; they must be synchronised if shocks are compared.
        outputs: Names of the outputs.
    """
    inputs = [name for name in prepared.channels if name.endswith((".road", ".aero")) or name in ("road", *_LOADS)]
    moving = _moving(prepared, inputs)
    found: list[Excitation] = []
    notes: list[str] = []
    for number, (name, record) in enumerate(zip(prepared.names, prepared.records, strict=True)):
        same = [k for k in range(number) if moving[k] == moving[number] and _same(record, prepared.records[k], inputs)]
        if not moving[number]:
            notes.append(f"{name}: no actuator moves; omitted")
        elif same:
            baseline = (prepared.names[same[0]], prepared.records[same[0]])
            change = _shock_change(name, record, baseline, prepared.corners)
            if isinstance(change, str):
                notes.append(change)
            else:
                found.append(_shock_excitation(name, record, baseline[1], change, outputs))
        elif len(moving[number]) == 1:
            found.append(_excitation(name, record, moving[number][0], outputs))
        elif moving[number] in moving[:number]:
            first = prepared.names[moving.index(moving[number])]
            notes.append(f"{name}: its drive differs from that of {first}, or is not in step with it; omitted")
    return _ExcitationList(tuple(found), tuple(notes))


def _moving(prepared: Prepared, inputs: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the names of the inputs that move in each test."""
    sizes = [_sizes(record, inputs) for record in prepared.records]
    largest = {kind: max(_of_kind(each, kind) for each in sizes) for kind in {_kind(name) for name in inputs}}
    return [tuple(n for n in inputs if _moves(n, size, largest[_kind(n)])) for size in sizes]


class _Change(NamedTuple):
    """Change of a shock: name of its force, and change of its force difference (N,)."""

    force: str
    values: Array


def _sizes(record: TimeSeries, inputs: Sequence[str]) -> dict[str, float]:
    """Return the standard deviation of each input; 0 if the input is only noise."""
    return {name: float(record[name].std()) if _is_driven(record, name) else 0.0 for name in inputs}


def _is_driven(record: TimeSeries, name: str) -> bool:
    """Return whether an input was driven: its command moves, or without a command it is not white noise."""
    values, command = record[name], f"{name}_command"
    if command in record:
        return bool(record[command].std() > COMMANDED * values.std())
    return bool(np.std(np.diff(values)) < WHITE * values.std())


def _moves(name: str, sizes: Mapping[str, float], largest: float) -> bool:
    return sizes[name] > max(RESTING * _of_kind(sizes, _kind(name)), SMALLEST * largest)


def _of_kind(sizes: Mapping[str, float], kind: str) -> float:
    return max(size for name, size in sizes.items() if _kind(name) == kind)


def _kind(name: str) -> str:
    return name.rpartition(".")[2]


def _excitation(name: str, record: TimeSeries, source: str, outputs: Sequence[str]) -> Excitation:
    chosen = record.select(outputs)
    channel = Channel(source, record.unit(source))
    return Excitation(name, channel, record[source], chosen.values, _channels(chosen), record.sample_rate)


def _same(record: TimeSeries, first: TimeSeries, inputs: Sequence[str]) -> bool:
    """Return whether two tests have the same drive, sample by sample."""
    return len(record) == len(first) and not any(_differ(record[n], first[n]) for n in inputs if _is_driven(first, n))


def _shock_change(
    name: str, record: TimeSeries, baseline: tuple[str, TimeSeries], corners: Sequence[str]
) -> _Change | str:
    """Return the change of the shock, or a note on why the test cannot be used."""
    first = baseline[1]
    forces = [channel(corner, "force") for corner in corners]
    velocities = {force: force.removesuffix("force") + "velocity" for force in forces}
    rates = {force: _slope(first[force], first[velocity]) for force, velocity in velocities.items()}
    changes = {force: _change(record, first, force, velocities[force], rates[force]) for force in forces}
    largest = max(changes, key=lambda force: float(changes[force].std()))
    if changes[largest].std() < REPEATED * first[largest].std():
        return f"{name}: repeats {baseline[0]} with the same shocks; omitted"
    smallest = UNCHANGED * changes[largest].std()
    others = [force for force in forces if force != largest and changes[force].std() > smallest]
    if others:
        return f"{name}: {', '.join((largest, *others))} differ from {baseline[0]}; change one shock at a time"
    return _Change(largest, changes[largest])


def _differ(values: Array, first: Array) -> bool:
    return bool(np.std(values - first) > SAME_DRIVE * float(np.std(first)))


def _slope(force: Array, velocity: Array) -> float:
    """Return the slope of the best-fit line of force over velocity [N.s/m]: C-bar of 6.3.1."""
    return float(force @ velocity / (velocity @ velocity))


def _change(record: TimeSeries, first: TimeSeries, force: str, velocity: str, rate: float) -> Array:
    """Return the change of the force difference F - c v (Eq 4.24)."""
    now, before = (series[force] - rate * series[velocity] for series in (record, first))
    return np.asarray(now - before, dtype=np.float64)


def _shock_excitation(
    name: str, record: TimeSeries, first: TimeSeries, change: _Change, outputs: Sequence[str]
) -> Excitation:
    now, before = record.select(outputs), first.select(outputs)
    channel = Channel(change.force, record.unit(change.force))
    return Excitation(name, channel, change.values, now.values - before.values, _channels(now), record.sample_rate)


def _channels(series: TimeSeries) -> tuple[Channel, ...]:
    return tuple(Channel(n, u) for n, u in zip(series.names, series.units, strict=True))


def by_input(found: Sequence[Excitation]) -> Mapping[str, tuple[Excitation, ...]]:
    """Return the excitations of each input, in descending order of size."""
    names = dict.fromkeys(each.channel.name for each in found)
    return {
        name: tuple(sorted((e for e in found if e.channel.name == name), key=lambda e: -float(e.u.std())))
        for name in names
    }
