"""Builds of a report: their files, their comparison, the corners of a car, and the report as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product, takewhile
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import InputError, ParameterError
from eightpost.files import document_kind, sha256_of
from eightpost.ident.dyno_report.cycles import STROKES, Found, Stroke, Unknown, known, mean_of, of_known
from eightpost.ident.dyno_report.entry import (
    Entry,
    ForceBand,
    entry_of_shock,
    entry_of_table,
    entry_of_test,
    with_gas_of_slow_runs,
)
from eightpost.ident.dyno_report.loop import VelocityCurve, forces_at
from eightpost.rig import read_dyno_tests, split_runs
from eightpost.rig.columns import flips_of
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.dyno_test import FEWEST, SHORTEST, TemperatureEffect, runs_of_one_speed, temperature_effect
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.rig.plausibility import PLAUSIBLE
from eightpost.shock import read_shock
from eightpost.signals import ChannelMap, MappedChannel, faults, read_record, read_records
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.raw_record import RawRecord, find_time, mapped_series
from eightpost.units import compatible, convert, is_unit
from eightpost.vehicle import QuarterCar, StructuralVehicle, read_vehicle

# ==== Limits of a curve: a master curve with tolerances, and whether measured curves are within them =================

_TOLERANCE = "tol"  #: Beginning of the name of a column of tolerances, in letters of any case.


@dataclass(frozen=True, slots=True, eq=False)
class CurveLimits:
    """A master curve with its tolerance."""

    name: str  #: Name of the file.
    master: VelocityCurve  #: Curve in the middle of the limits.
    tolerance: Array  #: Tolerance in either direction at the velocities of the curve (K,) [N].

    def at(self, speed: float, stroke: Stroke) -> tuple[float, float] | None:
        """Return the force of the master and its tolerance [N] at a speed [m/s]; None beyond the curve."""
        force = self.master.force_at(speed, stroke)
        if isinstance(force, Unknown):
            return None
        velocity = speed if stroke == "compression" else -speed
        return force, float(np.interp(velocity, self.master.velocity, self.tolerance))

    @property
    def band(self) -> ForceBand:
        """Limits over velocity."""
        master = self.master
        return ForceBand(master.velocity, master.force - self.tolerance, master.force + self.tolerance)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Stroke of an entry, judged at the speed at which it is farthest from the master."""

    entry: Entry
    stroke: Stroke
    count: int  #: Number of speeds that were judged.
    #: Speed [m/s], force [N], and force and tolerance of the master [N] there.
    speed: float
    force: float
    master: float
    tolerance: float

    @property
    def deviation(self) -> float:
        """Force minus that of the master [N]."""
        return self.force - self.master

    @property
    def passed(self) -> bool:
        """Whether the deviation is within the tolerance."""
        return abs(self.deviation) <= self.tolerance

    @property
    def text(self) -> str:
        """Force and limits at that speed, as text."""
        values = (convert(v, "N", "lbf") for v in (self.force, self.master, self.tolerance))
        force, master, tolerance = (f"{value:.3g}" for value in values)
        return f"{force} lbf at {convert(self.speed, 'm/s', 'in/s'):.3g} in/s, master {master} ± {tolerance} lbf"


def _tolerances_in(record: RawRecord, path: Path) -> tuple[Array, Array, str] | None:
    """Return speeds [m/s] and tolerances by speed, with their unit, `N` or `%`; None without such a column."""
    places = [k for k, name in enumerate(record.names) if name.strip().lower().startswith(_TOLERANCE)]
    speeds = [(k, unit) for k, unit in enumerate(record.units) if unit and compatible(unit, "m/s")]
    if not places or not speeds:
        return None
    (speed, speed_unit), unit = speeds[0], record.units[places[0]] or ""
    if unit != "%" and not compatible(unit, "N"):
        raise InputError(f"{path}: the tolerance needs the unit % or one of force, such as [N], not {unit!r}")
    at = np.abs(convert(record.numbers(speed, channel="speed"), speed_unit, "m/s"))
    values = record.numbers(places[0], channel="tolerance")
    order = np.argsort(at)
    return at[order], (values if unit == "%" else convert(values, unit, "N"))[order], "%" if unit == "%" else "N"


# ==== Builds with their clicks =======================================================================================

FAST = 0.9  #: Minimum share of the highest speed of a build's entries for an entry to represent it.
#: Speeds of the tables [m/s] unless others are given: 1 to 20 in/s, as far as any curve goes.
SPEEDS = tuple(float(convert(speed, "in/s", "m/s")) for speed in (1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0))
LONG_NAME = 20  #: Names are shortened if one has more letters than this.


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return names without their common beginning, up to a separator, if one of them is long.

    >>> short_names(["ohlins_t1_18_18_s5_150psi", "ohlins_t1_24_24_s5_100psi"])
    {'ohlins_t1_18_18_s5_150psi': '18_18_s5_150psi', 'ohlins_t1_24_24_s5_100psi': '24_24_s5_100psi'}
    """
    names = list(dict.fromkeys(names))
    letters = zip(*names, strict=False) if len(names) > 1 and max(map(len, names)) > LONG_NAME else ()
    common = "".join(column[0] for column in takewhile(lambda column: len(set(column)) == 1, letters))
    cut = max(common.rfind(separator) for separator in "_- .") + 1
    return {name: name[cut:] for name in names}


# ---- Variants: builds with their clicks -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class BuildVariant:
    """A build at one setting of the adjusters."""

    label: str  #: Display name: the build in short, and the clicks if the report has several of this build.
    build: str  #: Name of the build.
    entries: tuple[Entry, ...]  #: Entries in the order of the files.

    @property
    def runs(self) -> tuple[Entry, ...]:
        """Runs of this build."""
        return tuple(entry for entry in self.entries if entry.kind == "run")

    def of_basis(self, basis: str) -> tuple[Entry, ...]:
        """Return the entries that are `measured`, or laws."""
        return tuple(entry for entry in self.entries if (entry.kind == "law") == (basis == "law"))

    def representatives(self, basis: str) -> tuple[Entry, ...]:
        """Return the entries of a basis that reach 90 % of the highest speed among them."""
        found = self.of_basis(basis)
        highest = max((entry.highest for entry in found), default=0.0)
        return tuple(entry for entry in found if entry.highest >= FAST * highest)


def variants_of(entries: Sequence[Entry]) -> tuple[BuildVariant, ...]:
    """Return the builds with their clicks; a law without clicks belongs to the clicks of its build if there is one."""
    stated: dict[str, list[str | None]] = {}
    for entry in entries:
        known = stated.setdefault(entry.setting.build, [])
        if entry.setting.clicks not in known:
            known.append(entry.setting.clicks)
    groups: dict[tuple[str, str | None], list[Entry]] = {}
    for entry in entries:
        build, clicks = entry.setting.build, entry.setting.clicks
        named = [one for one in stated[build] if one is not None]
        if entry.kind == "law" and clicks is None and len(named) == 1:
            clicks = named[0]
        groups.setdefault((build, clicks), []).append(entry)
    several = {build for build, _ in groups if sum(key[0] == build for key in groups) > 1}
    short = short_names(stated)
    return tuple(
        BuildVariant(f"{short[build]}, {clicks or 'clicks not stated'}" if build in several else short[build], build,
                tuple(found))
        for (build, clicks), found in groups.items()
    )  # fmt: skip


def mean_force(entries: Iterable[Entry], speed: float, stroke: Stroke) -> Found:
    """Return the mean force magnitude [N] of the entries that reach a speed [m/s]."""
    return mean_of(forces_at(entry.curve, speed, stroke) for entry in entries)


def repeated_runs(variant: BuildVariant) -> tuple[tuple[Entry, ...], ...]:
    """Return the groups of two or more runs with the same gas pressure and standard deviations of velocity."""
    entries = {id(entry.test): entry for entry in variant.runs}
    same: list[tuple[Entry, ...]] = []
    for tests in runs_of_one_speed(entry.test for entry in variant.runs if entry.test):
        group = [entries[id(test)] for test in tests]
        for pressure in dict.fromkeys(entry.setting.gas_pressure for entry in group):
            same.append(tuple(entry for entry in group if entry.setting.gas_pressure == pressure))
    return tuple(group for group in same if len(group) > 1)


def deviation_of(group: Iterable[Entry], speed: float, stroke: Stroke) -> Found:
    """Return the standard deviation of the forces [N] of runs at a speed [m/s]."""
    forces = known(forces_at(entry.curve, speed, stroke) for entry in group)
    return float(np.std(forces, ddof=1)) if len(forces) > 1 else Unknown("fewer than two runs reach this speed")


def heat_effect(variant: BuildVariant) -> TemperatureEffect | None:
    """Return the change of force with temperature over the repeated runs of a variant; None without them."""
    return temperature_effect(entry.test for entry in variant.runs if entry.test)


# ---- Corners of a car -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CarCorner:
    """A corner of a car; a ParameterError is raised if a value is not positive."""

    name: str
    mass: float  #: Sprung mass on the corner [kg].
    wheel_rate: float  #: Rate of the suspension at the wheel [N/m].
    motion_ratio: float = 1.0  #: Damper travel per wheel travel [1].

    def __post_init__(self) -> None:
        for what, value, option in (
            ("sprung mass", self.mass, "--set corner-mass"),
            ("wheel rate", self.wheel_rate, "--set wheel-rate"),
            ("motion ratio", self.motion_ratio, "--set motion-ratio"),
        ):
            if not value > 0.0:
                raise ParameterError(f"{self.name}: the {what} must be above 0, not {value:g}; correct {option}")

    def damping_ratio(self, rate: Found) -> Found:
        """Return c r^2 / (2 sqrt(k m)) [1] of a damping rate c at the damper [N.s/m].

        The tire is rigid in this equation, and the damper moves r times as far as the wheel.
        """
        return of_known(lambda c: c * self.motion_ratio**2 / (2.0 * sqrt(self.wheel_rate * self.mass)), rate)


def corners_of_car(path: Path, motion_ratio: float = 1.0) -> tuple[CarCorner, ...]:
    """Return the corners of a car file: one of a quarter car, four of a seven-DOF car with the static weight of each.

    Raises:
        InputError: The file is an identified model, which has no separate masses and rates.
    """
    vehicle = read_vehicle(path)
    if not isinstance(vehicle, StructuralVehicle):
        raise InputError(
            f"{path} is an identified model without separate masses and wheel rates; give a .toml file, or "
            "--set corner-mass and --set wheel-rate"
        )
    found = vehicle.parameters
    if isinstance(found, QuarterCar):
        return (CarCorner(vehicle.name, found.sprung_mass, found.suspension_stiffness, motion_ratio),)
    front = 0.5 * found.sprung_mass * found.cg_to_rear_axle / found.wheelbase
    rear = 0.5 * found.sprung_mass * found.cg_to_front_axle / found.wheelbase
    masses = (front, front, rear, rear)
    return tuple(
        CarCorner(corner, mass, rate, motion_ratio)
        for corner, mass, rate in zip(CORNERS, masses, found.spring_rate, strict=True)
    )


# ---- The report -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class DynoReport:
    """Content of a report."""

    entries: tuple[Entry, ...]  #: Runs, tables and laws.
    variants: tuple[BuildVariant, ...]  #: Builds with their clicks; the reference is the first.
    speeds: tuple[float, ...]  #: Speeds of the tables [m/s].
    corners: tuple[CarCorner, ...] = ()  #: Corners for damping ratios.
    fitted_to: Mapping[str, str] = field(default_factory=dict)  #: Build of corners of the car: a name for each corner.
    limits: CurveLimits | None = None  #: Curve with tolerances that the measured curves must meet.
    #: Velocities of the shaft on a track (N,) [m/s] by name of the file.
    track: Mapping[str, Array] = field(default_factory=dict)

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """Strokes of runs and tables, judged by the limits; nothing without limits."""
        found: list[Judgement] = []
        if (limits := self.limits) is None:
            return ()
        for entry, stroke in product((entry for entry in self.entries if entry.kind != "law"), STROKES):
            pairs = [(v, forces_at(entry.curve, v, stroke), limits.at(v, stroke)) for v in self.speeds]
            judged = [(abs(force - limit[0]) / max(limit[1], 1e-12), v, force, *limit)
                      for v, force, limit in pairs if isinstance(force, float) and limit is not None]  # fmt: skip
            found += [Judgement(entry, stroke, len(judged), *max(judged)[1:])] if judged else []
        return tuple(found)

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Names of runs and tables without a curve at a speed of the master; of laws if there is nothing else."""
        judged = {one.entry.name for one in self.judgements}
        measured = [entry for entry in self.entries if entry.kind != "law"] or self.entries
        return tuple(entry.name for entry in measured if self.limits is not None and entry.name not in judged)

    @property
    def runs(self) -> tuple[Entry, ...]:
        """Runs of all variants."""
        return tuple(entry for entry in self.entries if entry.kind == "run")


def dyno_report(
    entries: Sequence[Entry],
    *,
    speeds: Sequence[float] = (),
    corners: Sequence[CarCorner] = (),
    fitted_to: Mapping[str, str] | None = None,
    limits: CurveLimits | None = None,
    track: Mapping[str, Array] | None = None,
) -> DynoReport:
    """Return the report of entries; the arguments are its fields, with speeds of 1 to 20 in/s that a curve reaches.

    Raises:
        InputError: A name is not a build of the report, or a speed is not positive.
    """
    variants = variants_of(entries)
    fitted = dict(fitted_to or {})
    for corner, build in fitted.items():
        if not any(build in (v.label, v.build) for v in variants):
            listed = ", ".join(dict.fromkeys(name for variant in variants for name in (variant.build, variant.label)))
            raise InputError(f"--corner {corner}={build}: {build!r} is not one of the builds: {listed}")
    if wrong := [speed for speed in speeds if not speed > 0.0]:
        raise InputError(f"--set speed must be above 0, not {wrong[0]:g} m/s")
    reached = max((entry.highest for entry in entries), default=0.0)
    shown = tuple(sorted(set(speeds))) or tuple(speed for speed in SPEEDS if speed <= reached) or SPEEDS[:1]
    return DynoReport(tuple(entries), variants, shown, tuple(corners), fitted, limits, dict(track or {}))


# ==== Reading of files, and the build to which each of them belongs ==================================================


@dataclass(frozen=True, slots=True)
class Reading:
    """Options of reading the files of a report."""

    #: Options of `eightpost.rig.read_dyno_tests` for all records: channel map, units and so on.
    options: Mapping[str, Any] = field(default_factory=dict)
    #: Channels to reverse, for all files (empty name) or by name of a file.
    flip: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Build, and settings of the adjusters, of files, by name of the file.
    builds: Mapping[str, str] = field(default_factory=dict)
    clicks: Mapping[str, str] = field(default_factory=dict)
    split: bool = False  #: Whether to split records into runs.
    cycle: str | int = "mean"  #: Cycle of a steady sine that is shown: `mean` of all, the `last`, or its number.

    def check(self, paths: Sequence[Path]) -> None:
        """Check that every file that an option names is given.

        Raises:
            InputError: An option names another file.
        """
        names = {name for path in paths for name in _names(path)}
        for option, given in (("--build", self.builds), ("--set clicks", self.clicks), ("--channel", self.flip)):
            for name in given:
                if name and name not in names:
                    listed = ", ".join(path.name for path in paths)
                    raise InputError(f"{option}: {name!r} is not one of the files: {listed}")


def _names(path: Path) -> tuple[str, ...]:
    return str(path), path.name, path.stem


def _chosen(given: Mapping[str, str], path: Path) -> str | None:
    return next((given[name] for name in _names(path) if name in given), None)


def read_entries(
    paths: Sequence[Path], reading: Reading, *, advance: Callable[[float], None] | None = None
) -> tuple[Entry, ...]:
    """Return the entries of dynamometer files and shock files.

    The build of an entry is the one given for its file, else the one stated in the file. A shock file without a build
    belongs to the build of the record that it was fitted to, if that record is among the files. Otherwise the name of
    the file is the build.

    Raises:
        InputError: A file cannot be read, or there is no file.
    """
    entries: list[Entry] = []
    shocks: list[Path] = []
    for done, path in enumerate(paths, 1):
        if path.suffix.lower() == ".json" and document_kind(path) is not None:
            shocks.append(path)
        else:
            entries += _dynamometer_entries(path, reading)
        if advance is not None:
            advance(done)
    builds = {entry.sha256: entry.setting.build for entry in entries if entry.sha256}
    for path in shocks:
        shock = read_shock(path)
        stated = shock.conditions.get("build")
        fitted = next((builds[e["sha256"]] for e in shock.inputs if e.get("sha256") in builds), None)
        build = _chosen(reading.builds, path) or (str(stated) if stated else None) or fitted or path.stem
        entry = entry_of_shock(shock, path.stem, build, source=path, sha256=sha256_of(path))
        clicks = _chosen(reading.clicks, path)
        entries.append(replace(entry, setting=replace(entry.setting, clicks=clicks)) if clicks else entry)
    if not entries:
        raise InputError("there is no file: give dynamometer files, shock files, or both")
    return with_gas_of_slow_runs(_with_unique_names(entries))


def _dynamometer_entries(path: Path, reading: Reading) -> Iterator[Entry]:
    build, clicks = _chosen(reading.builds, path), _chosen(reading.clicks, path)
    if tables := peak_velocity_tables(path, **reading.options):
        if clicks and len(tables) == 1:
            tables = (replace(tables[0], clicks=clicks),)
        for number, table in enumerate(tables, 1):
            name = f"{path.stem} {table.clicks or number}" if len(tables) > 1 else path.stem
            yield entry_of_table(table, name, build or path.stem)
        return
    given = DynoConditions(build, clicks)
    tests = read_dyno_tests(path, flip=flips_of(path, reading.flip), conditions=given, **reading.options)
    runs = [run for test in tests for run in (split_runs(test) if reading.split else (test,))]
    for number, run in enumerate(runs, 1):
        name = path.stem if len(runs) == 1 else f"{path.stem} {run.conditions.run or 'run'} {number}"
        yield entry_of_test(run, name, run.conditions.build or path.stem, cycle=reading.cycle)


def _with_unique_names(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the entries in short, with the law's name, or a number, after names that occur several times."""
    found: list[Entry] = []
    taken: set[str] = set()
    short = short_names(entry.name for entry in entries)
    for entry in entries:
        name, number = short[entry.name], 2
        if name in taken and entry.shock:
            name = f"{short[entry.name]} {entry.shock.law_name}"
        while name in taken:
            name, number = f"{short[entry.name]} ({number})", number + 1
        taken.add(name)
        found.append(replace(entry, name=name))
    return tuple(found)


def read_limits(path: Path, reading: Reading, tolerances: Sequence[tuple[float, str]]) -> CurveLimits:
    """Return the limits of a master curve: of a dynamometer file or a shock file with one curve.

    Args:
        path: File; its column of tolerances by speed (`tolerance [N]` or `[%]`) takes precedence.
        reading: Options of reading the file.
        tolerances: Values with the unit `%` of the master's force or `N`; the largest one counts.

    Raises:
        InputError: The file has several curves or an unknown one, or there is no tolerance, or one is not positive.
    """
    entries = read_entries([path], reading)
    if len(entries) > 1:
        raise InputError(f"--limits {path.name} has {len(entries)} curves; give a file with one")
    curve, name = entries[0].curve, path.name
    if isinstance(curve, Unknown):
        raise InputError(f"--limits {name}: the file has no curve: {curve.reason}")
    columns = [_tolerances_in(record, path) for record in (() if entries[0].shock else read_records(path))]
    column = next((column for column in columns if column is not None), None)
    if wrong := [v for v in (column[1].tolist() if column else [v for v, _ in tolerances]) if not v > 0.0]:
        raise InputError(f"--limits {name}: a tolerance must be above 0, not {wrong[0]:g}")
    if column is not None:
        sizes = [(np.interp(np.abs(curve.velocity), *column[:2]), column[2])]
    else:
        sizes = [(np.full(curve.force.size, value), unit) for value, unit in tolerances]
    if not sizes:
        raise InputError(f"--limits {name} has no column of tolerances; add --set tolerance='5 %' or tolerance='20 N'")
    forces = [size if unit == "N" else 0.01 * size * np.abs(curve.force) for size, unit in sizes]
    return CurveLimits(name, curve, np.max(forces, axis=0))


def read_track(path: Path, column: str | None = None) -> Array:
    """Return the velocity of the shaft (N,) [m/s] in a record of a track, at even times.

    Args:
        path: File of the record; its other columns may be incomplete.
        column: Column with the velocity, or with the displacement, of which the derivative is taken; default: the
            only one that is a velocity, else the only one that is a displacement.

    Raises:
        InputError: There is no such column, or several, or the velocity is not that of a shaft.
    """
    record = read_record(path)
    units = {name: unit for name, unit in zip(record.names, record.units, strict=True) if unit and is_unit(unit)}
    kinds = [[name for name in units if compatible(units[name], si) and column in (None, name)] for si in ("m/s", "m")]
    fitting = kinds[0] or kinds[1]
    if len(fitting) != 1:
        what = f"there is no column {column!r} with" if column else f"{len(fitting) or 'no'} columns have"
        listed = ", ".join(f"{name} [{unit}]" for name, unit in units.items())
        raise InputError(
            f"--set track={path.name}: {what} a unit of velocity or length; name one, --set track={path.name}=COLUMN; "
            f"the file has: {listed}"
        )
    series = mapped_series(record, ChannelMap({"shaft": MappedChannel(fitting[0])}, find_time(record)))
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=record.origin)
    even = series if series.is_uniform else series.resample(series.sample_rate)
    velocity = even["shaft"]
    if not kinds[0]:
        velocity = velocity_from_displacement(velocity, even.sample_rate, min(50.0, 0.2 * even.sample_rate))
    if (highest := float(np.abs(velocity).max())) > PLAUSIBLE["velocity"][1]:
        raise InputError(
            f"--set track={path.name}: {fitting[0]!r} reaches {highest:.3g} m/s, which no shaft does; name its column, "
            f"--set track={path.name}=COLUMN"
        )
    return velocity
