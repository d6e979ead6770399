"""Tables of dynamometer files with the setting of each (TOML, docs/how_to/settings.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from eightpost import units
from eightpost.errors import FileFormatError, InputError, MissingChannelError, ParameterError
from eightpost.files import read_text
from eightpost.rig.columns import with_channels
from eightpost.rig.dyno_conditions import UNITS, DynoConditions, numbers_in, setting_in
from eightpost.rig.dyno_test import DynoTest, read_dyno_tests
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.shock import Axis
from eightpost.shock.settings import TEMPERATURE
from eightpost.toml_document import parse_model

SCHEMA = 1

#: Temperatures of files that differ by less than this [K] are one setting.
ALIKE = 3.0

_WORDS = {
    "extra_forbidden": "is not an entry of a table of settings (docs/how_to/settings.md lists the entries)",
}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Adjuster(_Strict):
    counted: str = ""
    unit: str = "click"
    reference: float | None = None
    lowest: float | None = None
    highest: float | None = None


class _Temperature(_Strict):
    reference: str | None = None


class _File(_Strict):
    path: str
    clicks: dict[str, float] = Field(default_factory=dict)
    temperature: str | None = None


class _Table(_Strict):
    schema_: int = Field(SCHEMA, alias="schema")
    name: str = ""
    law: str | None = None
    gas: str = "estimate"
    units: dict[str, str] = Field(default_factory=dict)
    channel: dict[str, str] = Field(default_factory=dict)
    flip: tuple[str, ...] = ()
    adjuster: dict[str, _Adjuster] = Field(default_factory=dict)
    temperature: _Temperature | None = None
    file: list[_File] = Field(min_length=2)


@dataclass(frozen=True, slots=True, eq=False)
class SettingsTable:
    """Files of a shock and their settings."""

    name: str  #: Name of the shock.
    law: str | None  #: Name of the law; None for the default.
    gas: str  #: Treatment of the gas force.
    axes: tuple[Axis, ...]  #: Adjusters, and the temperature if it is one; the nodes are the settings of the files.
    settings: tuple[tuple[float, ...], ...]  #: Setting of each file, a value per axis.
    tests: tuple[tuple[DynoTest, ...], ...]  #: Records of each file.
    files: tuple[Path, ...]  #: Path of each file.
    notes: tuple[str, ...] = ()  #: Sentences on settings that were taken from the names of the files.


def read_settings_table(path: str | Path, *, cutoff: float | None = None) -> SettingsTable:
    """Read a table and all its dynamometer files.

    Raises:
        FileFormatError: The table has an unknown, missing or wrong entry.
        InputError: A file cannot be read, or its setting is not given.
    """
    path = Path(path)
    return _read(parse_model(_Table, read_text(path), path, SCHEMA, _WORDS), path, cutoff)


def states_settings(paths: Sequence[Path]) -> bool:
    """Return whether the names of files contain different settings of one adjuster; `1A` and `2A` may be builds."""
    units = _units_of_names(paths)
    if len(units) != 1 or len({numbers_in(path.stem, units[0])[0] for path in paths}) < 2:
        return False
    return units[0] not in ("A", "V") or any(numbers_in(path.stem, units[0], has_decimals=True) for path in paths)


def _units_of_names(paths: Sequence[Path]) -> list[str]:
    """Return the units of which each name contains one number."""
    return [unit for unit in UNITS if all(len(numbers_in(path.stem, unit)) == 1 for path in paths)]


def settings_of_names(paths: Sequence[Path], *, cutoff: float | None = None) -> SettingsTable:
    """Read dynamometer files whose names contain their settings: `damper_2clicks.csv`, `1.5A.csv`.

    Raises:
        InputError: The names do not contain one number of clicks, amperes or volts each, or a file cannot be read.
    """
    units = _units_of_names(paths)
    if len(units) != 1 or len(paths) < 2:
        names = ", ".join(path.name for path in paths)
        what = "their names do not state one setting each, such as 2clicks or 1.5A; list them in a table"
        raise InputError(f"{names}: {what} (docs/how_to/settings.md)")
    adjuster = {UNITS[units[0]]: _Adjuster(unit=units[0])}
    table = _Table(schema=SCHEMA, adjuster=adjuster, file=[_File(path=str(path.absolute())) for path in paths])
    return _read(table, paths[0], cutoff)


def _read(table: _Table, path: Path, cutoff: float | None) -> SettingsTable:
    _check(table, path)
    table, notes = _with_settings_of_names(table)
    files = tuple(path.parent / entry.path for entry in table.file)
    reading: dict[str, Any] = {"units": table.units, "flip": table.flip, "cutoff": cutoff}
    reading["channel_map"] = with_channels(None, table.channel)
    tests = tuple(
        _tests_of(file, conditions=_conditions(entry, table), **reading)
        for file, entry in zip(files, table.file, strict=True)
    )
    columns = [
        [_clicks_of(entry, name, adjuster, path) for entry in table.file] for name, adjuster in table.adjuster.items()
    ]
    adjusters: list[tuple[str, _Adjuster | _Temperature]] = [*table.adjuster.items()]
    if table.temperature is not None:
        adjusters.append((TEMPERATURE, table.temperature))
        measured = [_temperature_of(entry, of, path) for entry, of in zip(table.file, tests, strict=True)]
        columns.append(joined_temperatures(measured))
    settings = tuple(zip(*columns, strict=True))
    axes = tuple(
        _axis(name, adjuster, column, path) for (name, adjuster), column in zip(adjusters, columns, strict=True)
    )
    return SettingsTable(table.name or path.stem, table.law, table.gas, axes, settings, tests, files, notes)


def _with_settings_of_names(table: _Table) -> tuple[_Table, tuple[str, ...]]:
    """Return a table whose files have the settings in their names where it states none, and a note on them."""
    files, found = [], []
    units = [adjuster.unit for adjuster in table.adjuster.values()]
    for entry in table.file:
        stem = Path(entry.path).stem
        more = {
            name: value
            for name, adjuster in table.adjuster.items()
            if name not in entry.clicks
            and (value := setting_in(stem, name, adjuster.unit if units.count(adjuster.unit) == 1 else "")) is not None
        }
        found += [f"{Path(entry.path).name} {name} {value:g}" for name, value in more.items()]
        files.append(entry.model_copy(update={"clicks": {**entry.clicks, **more}}) if more else entry)
    note = (f"settings from the names of the files: {', '.join(found)}",) if found else ()
    return table.model_copy(update={"file": files}), note


def _tests_of(file: Path, **reading: Any) -> tuple[DynoTest, ...]:
    try:
        return tuple(read_dyno_tests(file, **reading))
    except MissingChannelError as error:
        if not peak_velocity_tables(file, units=reading["units"], channel_map=reading["channel_map"]):
            raise
        what = "is a peak-velocity table, without time; `eightpost fit` makes a shock of each of its settings"
        raise FileFormatError(
            f"{what}, and `eightpost export --over` one table of several shocks", path=file
        ) from error


def _check(table: _Table, path: Path) -> None:
    if not table.adjuster and table.temperature is None:
        raise FileFormatError(
            "names no adjuster and no temperature; add a section such as [adjuster.rebound], or [temperature]",
            path=path,
        )
    if TEMPERATURE in table.adjuster:
        raise FileFormatError("an adjuster cannot be called 'temperature'; use the section [temperature]", path=path)
    for name in table.adjuster:
        if not name.isidentifier():
            raise FileFormatError(f"adjuster {name!r}: use letters, digits and _ in its name", path=path)
    for entry in table.file:
        if unknown := sorted(set(entry.clicks) - set(table.adjuster)):
            raise FileFormatError(
                f"file {entry.path!r}: there is no section [adjuster.{unknown[0]}] for clicks.{unknown[0]}", path=path
            )


def _conditions(entry: _File, table: _Table) -> DynoConditions:
    clicks = ", ".join(
        f"{name} {value:g} {table.adjuster[name].counted}".strip() for name, value in entry.clicks.items()
    )
    return DynoConditions(clicks=clicks or None)


def _clicks_of(entry: _File, name: str, adjuster: _Adjuster, path: Path) -> float:
    if "clicks" not in entry.model_fields_set and adjuster.reference is not None:
        advice = f"add clicks.{name} = ..., or clicks = {{}} if it was at the reference"
        raise FileFormatError(f"file {entry.path!r} states no clicks: {advice}", path=path)
    value = entry.clicks.get(name, adjuster.reference)
    if value is None:
        raise FileFormatError(
            f"file {entry.path!r}: clicks.{name} is missing, and [adjuster.{name}] has no reference", path=path
        )
    low, high = adjuster.lowest, adjuster.highest
    if (low is not None and value < low) or (high is not None and value > high):
        raise FileFormatError(
            f"file {entry.path!r}: clicks.{name} = {value:g} is beyond the adjuster's stops, {low} to {high}", path=path
        )
    if adjuster.unit == "click" and value != round(value):
        raise FileFormatError(f"file {entry.path!r}: clicks.{name} = {value:g} is not a whole number", path=path)
    return value


def _temperature_of(entry: _File, tests: Sequence[DynoTest], path: Path) -> float:
    """Return the temperature [K] of a file: the one given, or the mean of its channel."""
    if entry.temperature is not None:
        return _kelvin(entry.temperature, f"file {entry.path!r}: temperature", path)
    known = [test.series["temperature"] for test in tests if "temperature" in test.series]
    if not known:
        raise FileFormatError(
            f"file {entry.path!r} has no temperature channel; add an entry such as temperature = '40 degC'", path=path
        )
    return float(np.concatenate(known).mean())


def _kelvin(text: str, what: str, path: Path) -> float:
    try:
        return float(units.convert(*units.quantity(text), "K"))
    except (InputError, ValueError) as error:
        raise FileFormatError(f"{what} = {text!r}: {error}; write it as '40 degC'", path=path) from error


def joined_temperatures(values: Sequence[float]) -> list[float]:
    """Return temperatures [K] with those of one setting, at most `ALIKE` apart, replaced by their mean."""
    order = np.argsort(values)
    groups: list[list[int]] = []
    for k in order.tolist():
        if groups and values[k] - values[groups[-1][0]] <= ALIKE:
            groups[-1].append(k)
        else:
            groups.append([k])
    found = [0.0] * len(values)
    for group in groups:
        for k in group:
            found[k] = float(np.mean([values[i] for i in group]))
    return found


def _axis(name: str, adjuster: _Adjuster | _Temperature, column: Sequence[float], path: Path) -> Axis:
    nodes = tuple(sorted(set(column)))
    if len(nodes) < 2:
        raise FileFormatError(
            f"{name} has the same setting in all files, so its effect is unknown; leave out its section", path=path
        )
    if isinstance(adjuster, _Temperature):
        if adjuster.reference is None:
            return Axis(name, nodes, nodes[len(nodes) // 2], unit="K")
        wanted = _kelvin(adjuster.reference, "[temperature] reference", path)
        return Axis(name, nodes, min(nodes, key=lambda node: abs(node - wanted)), unit="K")
    if adjuster.reference is not None and adjuster.reference not in nodes:
        raise FileFormatError(
            f"[adjuster.{name}] reference = {adjuster.reference:g} is not the setting of a file; there are: "
            f"{', '.join(f'{node:g}' for node in nodes)}",
            path=path,
        )
    reference = _most_common(column) if adjuster.reference is None else adjuster.reference
    try:
        return Axis(name, nodes, reference, adjuster.unit, adjuster.counted, adjuster.lowest, adjuster.highest)
    except ValueError as error:
        raise ParameterError(f"{path}: {error}") from error


def _most_common(column: Sequence[float]) -> float:
    """Return the value that most files have, of equally common ones the middle one."""
    counts: Mapping[float, int] = {value: list(column).count(value) for value in sorted(set(column))}
    common = [value for value, count in counts.items() if count == max(counts.values())]
    return common[len(common) // 2]
