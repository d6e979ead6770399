"""Scenario of a run, and the resolved connections of its system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from math import isfinite
from pathlib import Path

import numpy as np

from cosim.components.component import Component, Conversion, convert_between, named_unit
from cosim.systems.system import System
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError, WiringError
from eightpost.signals import Drivefile

# ---- Scenario: length, drive, recorded signals ----------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class Scenario(Summarized):
    """A run of a system.

    Raises:
        InputError: A time is not positive and finite, or the drive does not cover the run.
    """

    stop: float  #: Duration [s].
    drive: Drivefile | None = None  #: Signals for the inputs that no component feeds.
    #: Input that each channel of `drive` feeds: `{"lf.road": "car.lf.road"}`. Empty: every channel feeds the only
    #: component input of that name.
    targets: Mapping[str, str] = field(default_factory=dict)
    record: tuple[str, ...] = ()  #: Variables to record, as `component.variable`; empty: every output.
    #: Time between recorded samples [s], a whole number of coupling steps; None: every step.
    record_step: float | None = None
    settling: float = 0.0  #: Time at the start that is excluded from response measures [s].
    drive_start: float = 0.0  #: Time in the drive at which the run starts [s]; the drive must cover the whole run.

    def __post_init__(self) -> None:
        self._check_types()
        if not (isfinite(self.stop) and self.stop > 0.0):
            raise InputError(f"scenario: stop must be a positive time, not {self.stop!r} s")
        if self.record_step is not None and not (isfinite(self.record_step) and self.record_step > 0.0):
            raise InputError(f"scenario: record_step must be a positive time, not {self.record_step!r} s")
        self._check_cover()
        if not 0.0 <= self.settling < self.stop:
            raise InputError(
                f"scenario: settling must be shorter than the run ({self.stop} s), not {self.settling!r} s"
            )

    def _check_types(self) -> None:
        for name in ("stop", "record_step", "settling", "drive_start"):
            if isinstance(value := getattr(self, name), str):
                raise InputError(f"scenario: {name} is {value!r}; give a number of seconds")
        if self.drive is not None and not isinstance(self.drive, Drivefile):
            what = f"Drivefile.read({str(self.drive)!r})" if isinstance(self.drive, str | Path) else "a Drivefile"
            raise InputError(f"scenario: drive is a {type(self.drive).__name__}; give {what}")
        if isinstance(self.record, str):
            raise InputError(f"scenario: record is a text; give a list of names: [{self.record!r}]")

    def _summary(self) -> Summary:
        return Summary.of("Scenario", *self.summary_rows())

    def summary_rows(self) -> tuple[tuple[str, str], ...]:
        """Return duration, drive and recorded variables as rows of a summary."""
        every = "every step" if self.record_step is None else f"every {1e3 * self.record_step:g} ms"
        return (
            ("duration", f"{self.stop:g} s"),
            ("drive", "none" if self.drive is None else f"{some(self.drive.names)} from {self.drive_start:g} s"),
            ("record", f"{some(self.record) or 'every output'}, {every}"),
            ("settling", f"{self.settling:g} s" if self.settling else ""),
        )

    def _check_cover(self) -> None:
        if self.drive is None:
            return
        first, last = float(self.drive.series.time[0]), float(self.drive.series.time[-1])
        begin, end = self.drive_start, self.drive_start + self.stop
        slack = 1e-9 * max(abs(last), 1.0)
        if first > begin + slack or last < end - slack:
            raise InputError(
                f"scenario: the run takes {begin:g} to {end:g} s of the drive file, it holds {first:g} to {last:g} s: "
                "change stop or drive_start"
            )


# ---- Sources of every component's inputs, and their values at the start ---------------------------------------------


@dataclass(frozen=True, slots=True)
class Term:
    """Contribution of one output to an input: `gain * conversion(output)`."""

    source: str
    gain: float
    conversion: Conversion

    @property
    def part(self) -> str:
        """Component of the output."""
        return self.source.partition(".")[0]


@dataclass(frozen=True, slots=True)
class Feed:
    """All sources of one input: the terms of connections, a channel of the drive, a constant."""

    target: str
    terms: tuple[Term, ...]
    drive: int | None
    drive_conversion: Conversion
    constant: float

    @property
    def is_moving(self) -> bool:
        """Whether the input changes during a run."""
        return bool(self.terms) or self.drive is not None

    def value(self, outputs: Mapping[str, float], drive: Sequence[float]) -> float:
        """Return the input for values of the outputs (0 if not known yet) and of the drive's channels."""
        value = self.constant
        for term in self.terms:
            value += term.gain * term.conversion(outputs.get(term.source, 0.0))
        if self.drive is not None:
            value += self.drive_conversion(drive[self.drive])
        return float(value)


class Coupling:
    """Sources of every input, and the current values of all connections, `now`, until the first step."""

    def __init__(
        self, system: System, scenario: Scenario, *, every_step: Sequence[str] = (), recorded: Sequence[str] = ()
    ) -> None:
        """Resolve every connection.

        Args:
            system: Components and connections.
            scenario: Scenario with the drive.
            every_step: Variables to read after every step besides the connected ones, as `component.variable`.
            recorded: Variables to read at recorded points.

        Raises:
            WiringError: A drive channel has no input, an input has no source or two sources, or units do not fit.
        """
        self._first_drive: list[float] = []
        if scenario.drive:
            self._first_drive = scenario.drive.sample(np.array([scenario.drive_start]))[:, 0].tolist()
        self.components: Mapping[str, Component] = system.components
        self.feeds = _feeds(system, scenario)
        connected = {term.source for feeds in self.feeds.values() for feed in feeds for term in feed.terms}
        sources = connected | set(every_step)
        self._connected = connected
        self.outputs = {name: _names_of(name, sources) for name in self.components}
        self.recorded = {name: _names_of(name, set(recorded) - sources) for name in self.components}
        self.now: dict[str, float] = {}

    def feed_start(self, name: str) -> None:
        """Set a component's inputs to their values at the start, from the known outputs (0 if not known yet)."""
        if feeds := self.feeds[name]:
            values = [feed.value(self.now, self._first_drive) for feed in feeds]
            self.components[name].set([feed.target for feed in feeds], values)

    def read(self, name: str) -> dict[str, float]:
        """Return a component's connected outputs, and its other variables read in every step, by full name."""
        names = self.outputs[name]
        if not names:
            return {}
        return dict(zip((f"{name}.{n}" for n in names), self.components[name].get(names), strict=True))

    def order(self) -> tuple[tuple[str, ...], bool]:
        """Return the components sorted by their direct dependencies, and whether there is no dependency loop."""
        follows: dict[str, set[str]] = {name: set() for name in self.components}
        for name, feeds in self.feeds.items():
            direct = self.direct_inputs(name)
            follows[name] = {term.part for feed in feeds if feed.target in direct for term in feed.terms} - {name}
        try:
            return tuple(TopologicalSorter(follows).static_order()), True
        except CycleError:
            return tuple(self.components), False

    @property
    def has_loop(self) -> bool:
        """Whether components form a loop of connections."""
        takes = {name: {t.part for f in feeds for t in f.terms} - {name} for name, feeds in self.feeds.items()}
        try:
            TopologicalSorter(takes).prepare()
        except CycleError:
            return True
        return False

    def direct_inputs(self, name: str) -> frozenset[str]:
        """Return the inputs that connected outputs follow without delay; if no output is connected, use all outputs."""
        variables = self.components[name].variables
        outputs = [v for v in variables.values() if f"{name}.{v.name}" in self._connected] or list(variables.values())
        return frozenset().union(*(v.direct for v in outputs)) if outputs else frozenset()

    def held_inputs(self) -> frozenset[str]:
        """Return the inputs that change over a step but are held, because their component cannot ramp them."""
        return frozenset(
            f"{name}.{feed.target}"
            for name, feeds in self.feeds.items()
            if not self.components[name].capabilities.interpolates_inputs
            for feed in feeds
            if feed.is_moving
        )


def _names_of(component: str, full_names: set[str]) -> tuple[str, ...]:
    prefix = f"{component}."
    return tuple(sorted(name.removeprefix(prefix) for name in full_names if name.startswith(prefix)))


def _feeds(system: System, scenario: Scenario) -> dict[str, tuple[Feed, ...]]:
    terms: dict[str, list[Term]] = {}
    for connection in system.real_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        conversion = convert_between(source.unit, target.unit, str(connection))
        # A term applies the gain last, so an offset that is added after the gain is divided by the gain here.
        offset = conversion.offset + connection.offset / connection.gain
        term = Term(connection.source, connection.gain, Conversion(conversion.factor, offset))
        terms.setdefault(connection.target, []).append(term)
    driven = _driven(system, scenario)
    _check_drive(system, terms, driven)
    feeds: dict[str, tuple[Feed, ...]] = {}
    elsewhere = {connection.target for connection in system.discrete_connections}
    for name, component in system.components.items():
        inputs = [
            v
            for v in component.variables.values()
            if v.causality == "input" and v.type == "Real" and f"{name}.{v.name}" not in elsewhere
        ]
        feeds[name] = tuple(_feed(f"{name}.{v.name}", terms, driven, system.constants) for v in inputs)
    return feeds


def _feed(
    target: str,
    terms: Mapping[str, list[Term]],
    driven: Mapping[str, tuple[int, Conversion]],
    constants: Mapping[str, float],
) -> Feed:
    if target not in terms and target not in driven and target not in constants:
        raise WiringError(
            f"{target} is an input without a source: connect it, give the drive file a channel for it, or give it a "
            "constant value (constants in Python, [components.NAME.inputs] in the file)"
        )
    channel, conversion = driven.get(target, (None, Conversion()))
    short = target.partition(".")[2]
    return Feed(short, tuple(terms.get(target, ())), channel, conversion, constants.get(target, 0.0))


def _driven(system: System, scenario: Scenario) -> dict[str, tuple[int, Conversion]]:
    """Return, for each driven input, the channel of the drive and the conversion from its SI unit."""
    if scenario.drive is None:
        return {}
    driven = {}
    for target, index in targets_of(system, scenario).items():
        channel, source = scenario.drive.names[index], named_unit(scenario.drive.units[index])
        unit = system.input(target).unit
        driven[target] = (index, convert_between(source, unit, f"drive file {channel} -> {target}"))
    return driven


def targets_of(system: System, scenario: Scenario) -> dict[str, int]:
    """Return the index of the drive's channel for each input that it feeds.

    Raises:
        WiringError: A channel does not exist or does not match exactly one input, or two channels feed one input.
    """
    if scenario.drive is None:
        return {}
    targets = scenario.targets or {name: _only_input(system, name) for name in scenario.drive.names}
    found: dict[str, int] = {}
    for channel, target in targets.items():
        if channel not in scenario.drive.names:
            raise WiringError(f"the drive file has no channel {channel!r}; it has {', '.join(scenario.drive.names)}")
        if target in found:
            raise WiringError(f"two channels of the drive file feed {target}; keep one")
        found[target] = scenario.drive.names.index(channel)
    return found


def _only_input(system: System, channel: str) -> str:
    homes = [
        f"{name}.{channel}"
        for name, component in system.components.items()
        if (variable := component.variables.get(channel)) is not None and variable.causality == "input"
    ]
    if len(homes) != 1:
        found = " and ".join(homes) or "no input"
        raise WiringError(
            f"drive file channel {channel!r} matches {found}; name its input in the targets of [scenario] or "
            f'[[drive]], "{channel}" = "COMPONENT.INPUT"; in Python, Scenario(targets=...)'
        )
    return homes[0]


def _check_drive(system: System, terms: Mapping[str, object], driven: Mapping[str, object]) -> None:
    discrete = {connection.target for connection in system.discrete_connections}
    for target in driven:
        if target in discrete or ((target in terms or target in system.constants) and target not in system.sums):
            raise WiringError(
                f'{target} has two sources (the drive file and another); remove one, or add "{target}" to sums'
            )
