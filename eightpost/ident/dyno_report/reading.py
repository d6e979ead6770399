"""Reading of the files of a report, and the build to which each of them belongs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from eightpost.errors import InputError
from eightpost.files import document_kind, sha256_of
from eightpost.ident.dyno_report.entry import Entry, entry_of_shock, entry_of_table, entry_of_test
from eightpost.ident.dyno_report.shared_gas import with_gas_of_slow_runs
from eightpost.rig import read_dyno_tests, split_runs
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.shock import read_shock


@dataclass(frozen=True, slots=True)
class Reading:
    """Options of reading the files of a report.

    Attributes:
        options: Options of `eightpost.rig.read_dyno_tests` for all records: channel map, units and so on.
        flip: Channels to reverse, for all files (empty name) or by name of a file.
        builds: Build of files, by name of the file.
        clicks: Settings of the adjusters of files, by name of the file.
        split: Whether to split records into runs.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    flip: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    builds: Mapping[str, str] = field(default_factory=dict)
    clicks: Mapping[str, str] = field(default_factory=dict)
    split: bool = False

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
        yield entry_of_test(run, name, run.conditions.build or path.stem)


def _with_unique_names(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the entries with the law's name, or a number, after names that occur several times."""
    found: list[Entry] = []
    taken: set[str] = set()
    for entry in entries:
        name, number = entry.name, 2
        if name in taken and entry.shock:
            name = f"{entry.name} {entry.shock.law_name}"
        while name in taken:
            name, number = f"{entry.name} ({number})", number + 1
        taken.add(name)
        found.append(replace(entry, name=name))
    return tuple(found)
