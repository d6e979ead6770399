"""Reading of the files of a report, and the build to which each of them belongs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.files import document_kind, sha256_of
from eightpost.ident.dyno_report.builds import short_names
from eightpost.ident.dyno_report.entry import (
    Entry,
    entry_of_shock,
    entry_of_table,
    entry_of_test,
    with_gas_of_slow_runs,
)
from eightpost.ident.dyno_report.limits import Limits, limits_of
from eightpost.rig import read_dyno_tests, split_runs
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.dyno_test import FEWEST, SHORTEST
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.rig.plausibility import PLAUSIBLE
from eightpost.shock import read_shock
from eightpost.signals import ChannelMap, MappedChannel, faults, read_record, read_records
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.raw_record import find_time, mapped_series
from eightpost.units import compatible, is_unit


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
    #: Whether to split records into runs.
    split: bool = False
    #: Cycle of a steady sine that is shown: `mean` of all, the `last`, or its number.
    cycle: str | int = "mean"

    def check(self, paths: Sequence[Path]) -> None:
        """Check that every file that an option names is given.

        Raises:
            InputError: An option names another file.
        """
        names = {name for path in paths for name in _names(path)}
        for option, given in (("--build", self.builds), ("--clicks", self.clicks), ("--flip", self.flip)):
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

    Args:
        paths: Files of records, peak-velocity tables and shocks.
        reading: Options.
        advance: Callback that receives the number of files that were read.

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
    flips = [*reading.flip.get("", ()), *(f for name in _names(path) for f in reading.flip.get(name, ()))]
    given = DynoConditions(build, clicks)
    tests = read_dyno_tests(path, flip=tuple(dict.fromkeys(flips)), conditions=given, **reading.options)
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


def read_limits(path: Path, reading: Reading, tolerances: Sequence[tuple[float, str]]) -> Limits:
    """Return the limits of a master curve: of a dynamometer file or a shock file with one curve.

    Args:
        path: File; a table of peak velocities may have a column of tolerances.
        reading: Options, without builds and cycles.
        tolerances: Values with the unit `%` or `N` for a file without tolerances; the largest one counts.

    Raises:
        InputError: The file has several curves, or there is no tolerance.
    """
    entries = read_entries([path], reading)
    if len(entries) > 1:
        raise InputError(f"--limits {path.name} has {len(entries)} curves; give a file with one")
    records = () if entries[0].shock else read_records(path)
    return limits_of(entries[0], records, tolerances)


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
            f"--track {path.name}: {what} a unit of velocity or length; name one, --track {path.name}=COLUMN; the file "
            f"has: {listed}"
        )
    series = mapped_series(record, ChannelMap({"shaft": MappedChannel(fitting[0])}, find_time(record)))
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=record.origin)
    even = series if series.is_uniform else series.resample(series.sample_rate)
    velocity = even["shaft"]
    if not kinds[0]:
        velocity = velocity_from_displacement(velocity, even.sample_rate, min(50.0, 0.2 * even.sample_rate))
    if (highest := float(np.abs(velocity).max())) > PLAUSIBLE["velocity"][1]:
        raise InputError(
            f"--track {path.name}: {fitting[0]!r} reaches {highest:.3g} m/s, which no shaft does; name its column, "
            f"--track {path.name}=COLUMN"
        )
    return velocity
