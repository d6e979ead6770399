"""A study: which shocks may go where, on which drive, and what is asked of them (2.1.4, chapter 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import inf
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict, TypeAdapter

from cosim.study.measures import Measure
from cosim.study.setup import Setup, SetupSpace
from eightpost.errors import InputError

#: A parameter's value in its own unit.
Parameters = Mapping[str, float | bool | str]


@dataclass(frozen=True, slots=True)
class Build:
    """A shock of the bank.

    Args:
        fmu: Its file.
        parameters: Values that differ from the FMU's own, in their own units.
    """

    fmu: Path
    parameters: Parameters = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The vehicle.

    Args:
        fmu: Its file.
        name: Of its component, with which channels begin: `car.lf.tire_force`.
        parameters: Values that differ from the FMU's own, in their own units.
        inputs: Constant inputs, in their own units.
        means_trusted: Whether its response to constant inputs is known; if not, measures that hang on a mean are
            refused.
    """

    fmu: Path
    name: str = "car"
    parameters: Parameters = field(default_factory=dict)
    inputs: Mapping[str, float] = field(default_factory=dict)
    means_trusted: bool = True


@dataclass(frozen=True, slots=True)
class Drive:
    """A drivefile and what of it is run.

    Args:
        name: In the names of measures, where there are several drives.
        file: The drivefile.
        stop: Duration of the run [s].
        start: Time in the drivefile at which the run starts [s].
        units: Of channels whose header states none.
        channel_map: A channel-map file.
        targets: Which input each channel goes to; empty: the one of its name.
    """

    name: str
    file: Path
    stop: float
    start: float = 0.0
    units: Mapping[str, str] = field(default_factory=dict)
    channel_map: Path | None = None
    targets: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Term:
    """One term of the objective (Eq 2.6): `weight * value of the measure in unit`; without a unit, in SI."""

    measure: str
    weight: float = 1.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Constraint:
    """Bounds on a measure (G of Eq 2.3), in SI."""

    measure: str
    at_least: float = -inf
    at_most: float = inf


@dataclass(frozen=True)
class Study:
    """What is to be run and measured.

    Args:
        name: Of the study.
        vehicle: Any vehicle FMU with the ports of docs/ports.md.
        bank: Shocks by the name of the build.
        corners: Names of the builds that each corner may have.
        drives: One run of every setup on each.
        measures: What is drawn from the runs.
        objective: Weighted sum to minimise (Eq 2.6); empty: none.
        constraints: Setups outside them are not feasible (Eq 2.3).
        baseline: Build by corner of the setup that others are compared with; empty: none.
        alike: Groups of corners that have the same build.
        settling: Time at the start of every run that measures leave out [s].
        accuracy: Coupling error that is aimed at, in percent of each signal's standard deviation.
        record_step: Time between the samples that measures see [s].

    Raises:
        InputError: A corner may have a build that the bank lacks, names come twice, an objective or constraint names no
            measure, or the baseline is no setup.
    """

    name: str
    vehicle: Vehicle
    bank: Mapping[str, Build]
    corners: Mapping[str, tuple[str, ...]]
    drives: tuple[Drive, ...]
    measures: tuple[Measure, ...]
    objective: tuple[Term, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    baseline: Mapping[str, str] = field(default_factory=dict)
    alike: tuple[tuple[str, ...], ...] = ()
    settling: float = 2.0
    accuracy: float = 0.2
    record_step: float = 4e-3

    # An open bound is infinite, which JSON has no word for: it is written as the string "Infinity".
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(ser_json_inf_nan="strings")

    def __post_init__(self) -> None:
        self._check_builds()
        self._check_unique("measure", [measure.name for measure in self.measures])
        self._check_unique("drive", [drive.name for drive in self.drives])
        for drive in self.drives:
            self._check_times(drive)
        for measure in self.measures:
            if measure.drive and measure.drive not in [drive.name for drive in self.drives]:
                raise InputError(f"measure {measure.name!r}: there is no drive {measure.drive!r}")
        for name in (*(term.measure for term in self.objective), *(c.measure for c in self.constraints)):
            self.measure(name)
        if self.baseline:
            self.space.find(self.baseline)

    @property
    def space(self) -> SetupSpace:
        """All setups."""
        return SetupSpace(self.corners, self.alike)

    @property
    def baseline_setup(self) -> Setup | None:
        """The setup that others are compared with."""
        return self.space.find(self.baseline) if self.baseline else None

    def measure(self, name: str) -> Measure:
        """Return a measure by its name.

        Raises:
            InputError: There is none of that name; the message says which is close.
        """
        found = {measure.name: measure for measure in self.measures}
        if name not in found:
            close = get_close_matches(name, found, n=1)
            advice = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(found)}"
            raise InputError(f"there is no measure {name!r}; {advice}")
        return found[name]

    def measures_of(self, drive: Drive) -> tuple[Measure, ...]:
        """Return the measures that are drawn from the runs on a drive; those that name none are of the first."""
        first = drive is self.drives[0] or drive == self.drives[0]
        return tuple(m for m in self.measures if m.drive == drive.name or (not m.drive and first))

    def to_json(self) -> str:
        """Return the whole study as JSON."""
        return _ADAPTER.dump_json(self).decode()

    @classmethod
    def from_json(cls, text: str | bytes) -> Study:
        """Return the study that `to_json` wrote."""
        return _ADAPTER.validate_json(text)

    def _check_builds(self) -> None:
        if not self.corners:
            raise InputError("the study has no corners: the vehicle needs a port, or name them in [corners]")
        for corner, builds in self.corners.items():
            if not builds:
                raise InputError(f"corners: {corner} has no shock; name a build or more of the bank")
            for build in builds:
                if build not in self.bank:
                    close = get_close_matches(build, self.bank, n=1)
                    advice = f"; did you mean {close[0]}?" if close else ""
                    raise InputError(
                        f"corners: {corner} may have {build!r}, which is no build of the bank "
                        f"({', '.join(self.bank) or 'it is empty'}){advice}"
                    )

    def _check_unique(self, what: str, names: list[str]) -> None:
        if not names:
            raise InputError(f"the study has no {what}: it needs one or more")
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"two {what}s are called {doubled[0]!r}: give each a name of its own")

    def _check_times(self, drive: Drive) -> None:
        if not 0.0 <= self.settling < drive.stop:
            raise InputError(
                f"settling must be shorter than the run on {drive.name!r} ({drive.stop:g} s), not {self.settling:g} s"
            )


_ADAPTER: TypeAdapter[Study] = TypeAdapter(Study)
