"""Definition of a study: allowed shocks, drives, measures, objective and constraints (2.1.4, chapter 7)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from math import inf, isfinite, prod
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter

from cosim.components.component import Component
from cosim.study.measures import Measure
from cosim.systems.system import Bond
from eightpost.array_types import Integers
from eightpost.errors import InputError
from eightpost.signals import ChannelMap, Drivefile, MappedChannel

# ---- Ports of a vehicle for the shocks (docs/reference/ports.md) ----------------------------------------------------


def ports(vehicle: Component) -> tuple[str, ...]:
    """Return the corners at which a vehicle has a port (docs/reference/ports.md); `corner` for a quarter car."""
    names = vehicle.variables
    found = [
        name.removesuffix(".velocity")
        for name, variable in names.items()
        if name.endswith(".velocity") and variable.causality == "output"
    ]
    corners = tuple(c for c in found if f"{c}.force" in names and names[f"{c}.force"].causality == "input")
    is_quarter = {"velocity", "force"} <= set(names) and names["velocity"].causality == "output"
    return corners or (("corner",) if is_quarter else ())


def bond_at(vehicle: Component, name: str, corner: str, shock: Component) -> Bond:
    """Return the bond of a shock at a corner; the port of a quarter car has no corner in its name.

    Args:
        corner: Corner, which is also the name of the shock's component.
    """
    port = f"{name}.{corner}" if f"{corner}.velocity" in vehicle.variables else name
    return Bond.between(port, corner, displacement="displacement" in shock.variables, name=corner)


def check_corners(corners: Collection[str], vehicle: Component, file: Path) -> None:
    """Refuse corners that are not the vehicle's: a port without a shock would have no damping.

    Raises:
        InputError: The vehicle has no port for a shock, or not that of a corner, or a port has no shock.
    """
    known = ports(vehicle)
    if not known:
        raise InputError(f"vehicle.fmu: {file} has no port for a shock, so it is no vehicle that a study can run; name "
                         "a vehicle file or the FMU of a vehicle (docs/reference/ports.md)")  # fmt: skip
    count = f"the port {known[0]!r} only" if len(known) == 1 else f"ports at {', '.join(known)}"
    listed = f"{file} has {count}"
    if unknown := [corner for corner in corners if corner not in known]:
        raise InputError(f"corners: the vehicle has no port {unknown[0]!r}; {listed}. Name its ports in [corners], or "
                         "a vehicle that has these corners")  # fmt: skip
    if missing := [corner for corner in known if corner not in corners]:
        raise InputError(f"corners: {missing[0]} has no shock; {listed}. Name the builds allowed at {missing[0]}")


# ---- Setups: one build of the bank at every corner, numbered --------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Setup:
    """A build at every corner."""

    index: int  #: Number of the setup in its space.
    builds: Mapping[str, str]  #: Name of the build by corner.

    def __str__(self) -> str:
        """Return the builds corner by corner: `lf C/B, rf C/B, lr AA/B, rr C/C`."""
        return ", ".join(f"{corner} {build}" for corner, build in self.builds.items())


@dataclass(frozen=True)
class SetupSpace:
    """All setups that a study may choose from (Theta of Eq 2.3).

    A setup's number is a mixed-radix number: its digits are the positions of the corners' builds among the builds
    allowed there. The last corner is the last digit.

    Raises:
        InputError: A corner has no build or the same build twice, a group names an unknown corner, or the corners of a
            group have no build in common.
    """

    corners: Mapping[str, tuple[str, ...]]  #: Allowed builds by corner.
    alike: tuple[tuple[str, ...], ...] = ()  #: Groups of corners that always have the same build: `(("lf", "rf"),)`.

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", {name: tuple(builds) for name, builds in self.corners.items()})
        object.__setattr__(self, "alike", tuple(tuple(group) for group in self.alike))
        for corner, builds in self.corners.items():
            if not builds or len(set(builds)) < len(builds):
                raise InputError(f"corners: {corner} needs one or more different builds, not {list(builds)}")
        for group in self.alike:
            self._check_group(group)

    @property
    def radices(self) -> tuple[int, ...]:
        """Number of allowed builds at each corner."""
        return tuple(len(builds) for builds in self.corners.values())

    @property
    def full(self) -> int:
        """Number of setups without the restriction `alike`; every setup number is below it."""
        return prod(self.radices)

    def __len__(self) -> int:
        return int(self.indices.size)

    def __iter__(self) -> Iterator[Setup]:
        return (self.setup(int(index)) for index in self.indices)

    @cached_property
    def indices(self) -> Integers:
        """Numbers of all setups in increasing order (S,).

        Raises:
            InputError: There are more setups than the memory holds.
        """
        try:
            return self._numbers() if self.alike else np.arange(self.full, dtype=np.int64)
        except MemoryError as error:
            raise InputError(
                f"the builds of the corners give {self.full:.2g} setups, more than the memory holds; name fewer builds "
                "in [corners], or corners that have the same build in alike"
            ) from error

    def _numbers(self) -> Integers:
        """Return the numbers, found corner by corner: one that is like an earlier one has the build of that one."""
        numbers, chosen = np.zeros(1, dtype=np.int64), dict[str, Integers]()
        for corner, builds in self.corners.items():
            if mates := {mate for group in self.alike if corner in group for mate in group if mate in chosen}:
                first, *others = (_places_of(self.corners[mate], builds)[chosen[mate]] for mate in mates)
                rows = np.flatnonzero(np.all([first >= 0, *(first == other for other in others)], axis=0))
                places = first[rows]
            else:
                rows = np.repeat(np.arange(numbers.size), len(builds))
                places = np.tile(np.arange(len(builds)), numbers.size)
            chosen = {name: earlier[rows] for name, earlier in chosen.items()} | {corner: places}
            numbers = numbers[rows] * len(builds) + places
        return numbers

    def digits(self, indices: Integers) -> Integers:
        """Return the positions of the corners' builds (S, corners) for setups by number (S,)."""
        return np.stack(np.unravel_index(indices, self.radices), axis=-1).astype(np.int64)

    def setup(self, index: int) -> Setup:
        """Return a setup by its number.

        Raises:
            InputError: No setup has this number.
        """
        if not 0 <= index < self.full:
            raise InputError(f"there is no setup {index}; they are numbered 0 to {self.full - 1}")
        places = np.unravel_index(index, self.radices)
        pairs = zip(self.corners.items(), places, strict=True)
        return Setup(int(index), {corner: builds[int(place)] for (corner, builds), place in pairs})

    def find(self, builds: Mapping[str, str]) -> Setup:
        """Return the setup with the given builds by corner.

        Raises:
            InputError: A corner is missing or unknown, or its build is not allowed there.
        """
        if set(builds) != set(self.corners):
            raise InputError(
                f"a setup must give builds at {', '.join(self.corners)}, not at {', '.join(builds) or 'no corner'}"
            )
        return self.setup(int(np.ravel_multi_index([self._place(c, builds[c]) for c in self.corners], self.radices)))

    def _place(self, corner: str, build: str) -> int:
        allowed = self.corners[corner]
        if build not in allowed:
            close = get_close_matches(build, allowed, n=1)
            advice = f"; did you mean {close[0]}?" if close else ""
            raise InputError(f"{corner} cannot have the build {build!r}, only one of {', '.join(allowed)}{advice}")
        return allowed.index(build)

    def _check_group(self, group: tuple[str, ...]) -> None:
        if len(group) < 2 or (unknown := sorted(set(group) - set(self.corners))):
            what = f"there is no corner {unknown[0]!r}" if len(group) > 1 else "a group needs two or more corners"
            raise InputError(f"alike: {list(group)}: {what}; the corners are {', '.join(self.corners)}")
        if not set.intersection(*(set(self.corners[corner]) for corner in group)):
            raise InputError(
                f"alike: the corners {', '.join(group)} have no build in common; change [corners] or alike"
            )


def _places_of(builds: tuple[str, ...], allowed: tuple[str, ...]) -> Integers:
    """Return the place of each build (B,) among those allowed at a corner, -1 if it is not allowed there."""
    places = {build: place for place, build in enumerate(allowed)}
    return np.array([places.get(build, -1) for build in builds], dtype=np.int64)


# ---- The study ------------------------------------------------------------------------------------------------------

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
    units: str = ""  #: Units of the results, `us`, `si` or `file`; empty: those that the user has chosen.

    # An open limit is infinite, which JSON cannot represent as a number: it is written as the string "Infinity".
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(ser_json_inf_nan="strings")

    def __post_init__(self) -> None:
        self._check_builds()
        self._check_unique("measure", [measure.name for measure in self.measures])
        self._check_unique("drive", [drive.name for drive in self.drives])
        for drive in self.drives:
            if not 0.0 <= self.settling < drive.stop:
                raise InputError(
                    f"settling is {self.settling:g} s; it must be shorter than the run on {drive.name!r} "
                    f"({drive.stop:g} s)"
                )
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
    def allowed(self) -> tuple[str, ...]:
        """Builds that a corner allows."""
        return tuple(dict.fromkeys(build for builds in self.corners.values() for build in builds))

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


_ADAPTER: TypeAdapter[Study] = TypeAdapter(Study)


# ---- Drive files ----------------------------------------------------------------------------------------------------

#: Number of cached samples; a run requests the drive at its start and at all of its steps.
_CACHED = 4


@dataclass(frozen=True, slots=True, eq=False)
class RememberedDrive(Drivefile):
    """Drive file with cached samples: every setup requests the same times."""

    _samples: dict[bytes, NDArray[np.float64]] = field(init=False, repr=False, default_factory=dict)

    def sample(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values (C, K) at `times` (K,) [s]."""
        key = times.tobytes()
        if key not in self._samples:
            found = Drivefile.sample(self, times)
            found.setflags(write=False)
            if len(self._samples) == _CACHED:
                self._samples.clear()
            self._samples[key] = found
        return self._samples[key]


def driving_channels(drive: Drive) -> Drivefile:
    """Read the channels that drive; the other channels of a record are not read.

    Raises:
        DataError: The file cannot be read.
    """
    mapping = ChannelMap.read(drive.channel_map) if drive.channel_map else None
    if not drive.targets:
        return Drivefile.read(drive.file, channel_map=mapping, units=drive.units)
    named = mapping or ChannelMap()
    channels = {name: named.channels.get(name, MappedChannel(name)) for name in drive.targets}
    read = {"time", *channels, *(pick.source for pick in channels.values())}
    given = {name: unit for name, unit in drive.units.items() if name in read}
    return Drivefile.read(drive.file, channel_map=replace(named, channels=channels), units=given)


def read_drive(drive: Drive) -> RememberedDrive:
    """Read a drive file.

    Raises:
        InputError: The run exceeds the time range of the file.
        DataError: The file cannot be read.
    """
    found = driving_channels(drive)
    first, last = float(found.series.time[0]), float(found.series.time[-1])
    if drive.start < first - 1e-9 or drive.start + drive.stop > last * (1.0 + 1e-9) + 1e-9:
        raise InputError(
            f"drive {drive.name!r}: the run needs {drive.start:g} to {drive.start + drive.stop:g} s of {drive.file}, "
            f"which contains {first:g} to {last:g} s; change stop or start"
        )
    return RememberedDrive(found.series)
