"""Definition of a study: allowed shocks, drives, measures, objective and constraints (2.1.4, chapter 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import inf, isfinite
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict, TypeAdapter

from cosim.study.measures import Measure
from cosim.study.setup import Setup, SetupSpace
from eightpost.errors import InputError

#: Parameter values by name, each in the parameter's unit.
Parameters = Mapping[str, float | bool | str]


@dataclass(frozen=True, slots=True)
class Build:
    """A shock of the bank."""

    fmu: Path  #: FMU file.
    #: Values that differ from the FMU's defaults, in the parameters' units.
    parameters: Parameters = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The vehicle."""

    fmu: Path  #: FMU file.
    name: str = "car"  #: Name of the component, the first part of its channel names: `car.lf.tire_force`.
    #: Values that differ from the FMU's defaults, in the parameters' units.
    parameters: Parameters = field(default_factory=dict)
    inputs: Mapping[str, float] = field(default_factory=dict)  #: Constant inputs, in the inputs' units.
    #: Whether the response to constant inputs is reliable; if not, measures that depend on a mean are refused.
    means_trusted: bool = True


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive file and the part of it to run."""

    name: str  #: Name of the drive, used in the names of measures if there are several drives.
    file: Path  #: Path of the drive file.
    stop: float  #: Duration of the run [s].
    start: float = 0.0  #: Time in the drive file at which the run starts [s].
    units: Mapping[str, str] = field(default_factory=dict)  #: Units of channels whose header states none.
    channel_map: Path | None = None  #: Path of a channel-map file.
    #: Input by channel; empty: each channel drives the input of the same name.
    targets: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Term:
    """One term of the objective (Eq 2.6): `weight` times the measure in `unit`; empty unit: SI.

    Raises:
        InputError: The weight is not finite.
    """

    measure: str
    weight: float = 1.0
    unit: str = ""

    def __post_init__(self) -> None:
        if not isfinite(self.weight):
            raise InputError(f"objective: the weight of {self.measure!r} is {self.weight}; give a finite number")


@dataclass(frozen=True, slots=True)
class Constraint:
    """Limits of a measure (G of Eq 2.3), in SI.

    Raises:
        InputError: A limit is not a number, or the lower one is above the upper one.
    """

    measure: str
    at_least: float = -inf
    at_most: float = inf

    def __post_init__(self) -> None:
        if not self.at_least <= self.at_most:
            raise InputError(
                f"constraint of {self.measure!r}: at_least is {self.at_least:g} and at_most {self.at_most:g} (SI), so "
                "no setup can meet it; correct one of them"
            )


@dataclass(frozen=True)
class Study:
    """Definition of a study.

    Raises:
        InputError: A corner allows a build that is not in the bank, names are not unique, an objective or constraint
            names no measure, or the baseline is not a setup of the study.
    """

    name: str  #: Name of the study.
    vehicle: Vehicle  #: Vehicle FMU with the ports of docs/reference/ports.md.
    bank: Mapping[str, Build]  #: Shocks by build name.
    corners: Mapping[str, tuple[str, ...]]  #: Names of the allowed builds by corner.
    drives: tuple[Drive, ...]  #: Drives; every setup is run on each.
    measures: tuple[Measure, ...]  #: Measures to compute from the runs.
    objective: tuple[Term, ...] = ()  #: Weighted sum to minimise (Eq 2.6); empty: none.
    constraints: tuple[Constraint, ...] = ()  #: Constraints (Eq 2.3); setups that break one are not feasible.
    #: Build by corner of the setup that others are compared with; empty: no baseline.
    baseline: Mapping[str, str] = field(default_factory=dict)
    alike: tuple[tuple[str, ...], ...] = ()  #: Groups of corners that always have the same build.
    settling: float = 2.0  #: Time at the start of every run that measures exclude [s].
    accuracy: float = 0.2  #: Target coupling error, in percent of each signal's standard deviation.
    record_step: float = 4e-3  #: Sampling interval of the signals from which measures are computed [s].

    # An open limit is infinite, which JSON cannot represent as a number: it is written as the string "Infinity".
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(ser_json_inf_nan="strings")

    def __post_init__(self) -> None:
        self._check_builds()
        self._check_unique("measure", [measure.name for measure in self.measures])
        self._check_unique("drive", [drive.name for drive in self.drives])
        for drive in self.drives:
            self._check_times(drive)
        for measure in self.measures:
            if measure.drive and measure.drive not in [drive.name for drive in self.drives]:
                raise InputError(
                    f"measure {measure.name!r}: there is no drive {measure.drive!r}; the drives are "
                    f"{', '.join(drive.name for drive in self.drives)}"
                )
        for name in (*(term.measure for term in self.objective), *(c.measure for c in self.constraints)):
            self.measure(name)
        if self.baseline:
            self.space.find(self.baseline)

    @property
    def space(self) -> SetupSpace:
        """Space of all setups."""
        return SetupSpace(self.corners, self.alike)

    @property
    def named_measures(self) -> tuple[str, ...]:
        """Measures of the objective and the constraints; a study with neither names all its measures."""
        named = [*(term.measure for term in self.objective), *(one.measure for one in self.constraints)]
        return tuple(dict.fromkeys(named or [measure.name for measure in self.measures]))

    @property
    def baseline_setup(self) -> Setup | None:
        """Setup that others are compared with; None if the study has no baseline."""
        return self.space.find(self.baseline) if self.baseline else None

    def measure(self, name: str) -> Measure:
        """Return a measure by its name.

        Raises:
            InputError: There is no measure of that name; the message suggests a similar one.
        """
        found = {measure.name: measure for measure in self.measures}
        if name not in found:
            close = get_close_matches(name, found, n=1)
            advice = f"did you mean {close[0]!r}?" if close else f"the measures are {', '.join(found)}"
            raise InputError(f"there is no measure {name!r}; {advice}")
        return found[name]

    def measures_of(self, drive: Drive) -> tuple[Measure, ...]:
        """Return the measures that are computed from the runs on a drive; those without a drive belong to the first."""
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
            raise InputError("the study has no corners: the vehicle has no ports; name the corners in [corners]")
        for corner, builds in self.corners.items():
            if not builds:
                raise InputError(f"corners: {corner} has no shock; name one or more builds of the bank")
            for build in builds:
                if build not in self.bank:
                    close = get_close_matches(build, self.bank, n=1)
                    advice = f"; did you mean {close[0]}?" if close else ""
                    raise InputError(
                        f"corners: {corner} allows {build!r}, which is not a build of the bank "
                        f"({', '.join(self.bank) or 'it is empty'}){advice}"
                    )

    def _check_unique(self, what: str, names: list[str]) -> None:
        if not names:
            raise InputError(f"the study has no {what}; add one or more")
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"two {what}s are called {repeated[0]!r}; names must be unique")

    def _check_times(self, drive: Drive) -> None:
        if not 0.0 <= self.settling < drive.stop:
            raise InputError(
                f"settling is {self.settling:g} s; it must be shorter than the run on {drive.name!r} ({drive.stop:g} s)"
            )


_ADAPTER: TypeAdapter[Study] = TypeAdapter(Study)
