"""Integer, Boolean and enumeration variables in coupling, drive and recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cosim.components.component import DISCRETE, Component, Variable
from cosim.components.conversion import convert_between
from cosim.systems.coupling import targets_of
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.signals import Drivefile


@dataclass(frozen=True, slots=True)
class _Link:
    """Output that sets an input: `input = factor * output + offset`, rounded if the input is not Real."""

    source: str
    target: Variable
    factor: float
    offset: float

    def __call__(self, value: float) -> float:
        return _as_type(self.target.type, self.factor * value + self.offset)


@dataclass
class DiscreteExchange:
    """Discrete variables of a system, and their current values."""

    components: Mapping[str, Component]  #: All components by name.
    links: Mapping[str, _Link]  #: Link of each connected input, named `component.variable`.
    driven: Mapping[str, tuple[int, str]]  #: Channel of the drive and type of each driven discrete input.
    names: tuple[str, ...]  #: Discrete variables to record.
    drive: Drivefile | None = None  #: Drive of the scenario.
    drive_start: float = 0.0  #: Time in the drive at which the run starts [s].
    rows: list[list[float]] = field(default_factory=list)
    _set: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, scenario: Scenario, names: Iterable[str]) -> DiscreteExchange:
        """Collect the discrete variables that a system couples, drives and records."""
        driven = {
            target: (index, system.input(target).type)
            for target, index in targets_of(system, scenario).items()
            if system.input(target).type in DISCRETE
        }
        recorded = tuple(name for name in names if system.output(name).type in DISCRETE)
        return cls(system.components, _links(system), driven, recorded, scenario.drive, scenario.drive_start)

    @property
    def is_coupled(self) -> bool:
        """Whether inputs must be set before each step."""
        return bool(self.links or self.driven)

    @property
    def is_needed(self) -> bool:
        """Whether there is anything to do between steps."""
        return self.is_coupled or bool(self.names)

    def begin(self) -> None:
        """Forget the last run."""
        self.rows.clear()
        self._set.clear()

    def exchange(self, time: float) -> bool:
        """Set every input whose source has changed at `time` [s]; return whether there was one."""
        if not self.is_coupled:
            return False
        known = self._read(link.source for link in self.links.values())
        current = {target: link(known[link.source]) for target, link in self.links.items()} | self._driven_at(time)
        changed = {target: value for target, value in current.items() if self._set.get(target) != value}
        for name, inputs in _by_component(changed).items():
            self.components[name].set(inputs, [changed[f"{name}.{variable}"] for variable in inputs])
        self._set |= changed
        return bool(changed)

    def record(self, rows: int) -> None:
        """Record a row of discrete values if the loop has recorded more rows (`rows`) than this object."""
        if self.names and rows > len(self.rows):
            known = self._read(self.names)
            self.rows.append([known[name] for name in self.names])

    def _read(self, names: Iterable[str]) -> dict[str, float]:
        return {
            f"{name}.{variable}": value
            for name, variables in _by_component(dict.fromkeys(names)).items()
            for variable, value in zip(variables, self.components[name].get(variables), strict=True)
        }

    def _driven_at(self, time: float) -> dict[str, float]:
        """Return the inputs that the drive sets, at its latest sample; discrete values are not interpolated."""
        if self.drive is None or not self.driven:
            return {}
        series = self.drive.series
        at = time + self.drive_start
        place = max(0, int(np.searchsorted(series.time, at + 1e-9 * max(abs(at), 1e-3), "right")) - 1)
        return {target: _as_type(kind, float(series.values[k, place])) for target, (k, kind) in self.driven.items()}


def _as_type(kind: str, value: float) -> float:
    """Return a number converted to a variable's type: a Boolean is true unless 0, integers are rounded."""
    if kind == "Boolean":
        return float(value != 0.0)
    return value if kind == "Real" else float(round(value))


def _links(system: System) -> dict[str, _Link]:
    links = {}
    for connection in system.discrete_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        unit = convert_between(source.unit, target.unit, f"{connection.source} -> {connection.target}")
        factor, offset = connection.gain * unit.factor, connection.gain * unit.offset + connection.offset
        links[connection.target] = _Link(connection.source, target, factor, offset)
    return links


def _by_component(names: Iterable[str]) -> dict[str, list[str]]:
    variables: dict[str, list[str]] = {}
    for name in names:
        component, _, variable = name.partition(".")
        variables.setdefault(component, []).append(variable)
    return variables
