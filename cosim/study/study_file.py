"""Study files (TOML, docs/how_to/study.md): vehicle, drive files, banks, measures, objectives and constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from cosim.components.component import Variable, convert_between, named_unit, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.study.definition import (
    Build,
    Constraint,
    Drive,
    Study,
    Term,
    Vehicle,
    bond_at,
    check_corners,
    driving_channels,
    ports,
)
from cosim.study.measures import Car, Measure, family
from cosim.systems.system import System
from eightpost import units
from eightpost.display import some
from eightpost.errors import FileFormatError, InputError, WiringError
from eightpost.files import read_text
from eightpost.signals import ChannelMap, read_record
from eightpost.signals.raw_record import RawRecord, map_beside
from eightpost.toml_document import line_with, parse_model

SCHEMA = 1

#: A number in SI (for parameters and inputs in the variable's own unit), or a value with its unit: "2 in/s".
Value = float | str

#: Function that returns the FMU of a source file, building it if necessary.
Sources = Callable[[Path], Path]

_WORDS = {"extra_forbidden": "is not an entry of a study file (docs/how_to/study.md lists the entries)"}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", populate_by_name=True)


class _Part(_Strict):
    fmu: str
    parameters: dict[str, bool | Value] = Field(default_factory=dict)


class _Vehicle(_Part):
    name: str = "car"
    inputs: dict[str, Value] = Field(default_factory=dict)
    means: Literal["trusted", "untrusted"] | None = None


class _Drive(_Strict):
    file: str
    name: str = ""
    stop: Value | None = None
    start: Value = 0.0
    units: dict[str, str] = Field(default_factory=dict)
    channel_map: str | None = None
    targets: dict[str, str] = Field(default_factory=dict)


class _Measure(_Strict):
    name: str
    channels: tuple[str, ...]
    statistic: str = "rms"
    display: str = ""
    weights: tuple[float, ...] = ()
    band: tuple[Value, Value] | None = None
    section: tuple[Value, Value] | None = None
    options: dict[str, Value] = Field(default_factory=dict)
    drive: str = ""
    function: str = ""
    unit: str = ""


class _Term(_Strict):
    measure: str
    weight: float = 1.0
    unit: str | None = None


class _Constraint(_Strict):
    measure: str
    at_least: Value = -inf
    at_most: Value = inf


class _File(_Strict):
    schema_: int = Field(alias="schema")
    name: str = ""
    vehicle: _Vehicle
    bank: dict[str, Annotated[_Part, BeforeValidator(lambda part: {"fmu": part} if isinstance(part, str) else part)]]
    corners: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    alike: tuple[tuple[str, ...], ...] = ()
    baseline: dict[str, str] | str = Field(default_factory=dict)
    drive: tuple[_Drive, ...]
    families: tuple[str, ...] = ()
    measure: tuple[_Measure, ...] = ()
    objective: tuple[_Term, ...] = ()
    constraint: tuple[_Constraint, ...] = ()
    settling: Value = 2.0
    accuracy: float = Field(default=0.2, gt=0.0)
    record_step: Value = 4e-3
    units: Literal["us", "si", "file", ""] = ""


def read_study(path: str | Path, fmu: Sources = lambda path: path) -> Study:
    """Read a study file; paths in it are relative to it.

    Args:
        fmu: Function that returns the FMU of a path in the file; the path may be a source from which an FMU is built.

    Raises:
        InputError: The file cannot be read, or an entry is unknown, missing or wrong; the message states the line.
        FmuError: An FMU cannot be used.
    """
    path = Path(path)
    text = read_text(path)
    content = _content(path, text)
    try:
        return _Reader(path, content, fmu).study()
    except FileFormatError:
        raise
    except InputError as error:
        line = line_with(text, str(error))
        raise type(error)(f"{path}{f', line {line}' if line else ''}: {error}") from error


def source_files(path: str | Path) -> tuple[Path, ...]:
    """Return the files named in a study file from which an FMU must first be built: all that are not .fmu files.

    Raises:
        InputError: The file cannot be read, or an entry is unknown, missing or wrong.
    """
    path = Path(path)
    content = _content(path, read_text(path))
    files = [part.fmu for part in (content.vehicle, *content.bank.values())]
    return tuple(dict.fromkeys(path.parent / file for file in files if not file.endswith(".fmu")))


def bank_sources(path: str | Path) -> dict[str, Path]:
    """Return the file of each build of a study file whose parameters are those of the file.

    Raises:
        InputError: The file cannot be read, or an entry is unknown, missing or wrong.
    """
    path = Path(path)
    bank = _content(path, read_text(path)).bank
    return {name: path.parent / part.fmu for name, part in bank.items() if not part.parameters}


def _content(path: Path, text: str) -> _File:
    return parse_model(_File, text, path, SCHEMA, _WORDS)


class _Reader:
    """Conversion of a file's content into a study, with the variables of its FMUs."""

    def __init__(self, path: Path, content: _File, fmu: Sources) -> None:
        self._folder, self._path, self._content, self._fmu = path.parent, path, content, fmu
        self._units = dict[str, str]()  # SI unit of each channel of the vehicle and the shocks

    def study(self) -> Study:
        """Return the study."""
        content = self._content
        vehicle, car = self._vehicle()
        bank = {name: self._build(name, part) for name, part in content.bank.items()}
        corners = content.corners or dict.fromkeys(ports(car), tuple(bank))
        check_corners(corners, car, self._folder / content.vehicle.fmu)
        self._check_shocks(bank, vehicle, car, corners)
        drives = tuple(self._drive(drive, vehicle, car) for drive in content.drive)
        measures = self._measures(vehicle, car, tuple(corners), bank, drives)
        baseline = content.baseline
        return Study(
            name=content.name or self._path.stem,
            vehicle=vehicle,
            bank=bank,
            corners=corners,
            drives=drives,
            measures=measures,
            objective=tuple(_term(term, measures) for term in content.objective),
            constraints=tuple(_constraint(one, measures, self._units) for one in content.constraint),
            baseline=dict.fromkeys(corners, baseline) if isinstance(baseline, str) else baseline,
            alike=content.alike,
            settling=_si(content.settling, "settling", "s"),
            accuracy=content.accuracy,
            record_step=_si(content.record_step, "record_step", "s"),
            units=content.units,
        )

    def _check_shocks(
        self, bank: Mapping[str, Build], vehicle: Vehicle, car: FmuComponent, corners: Mapping[str, tuple[str, ...]]
    ) -> None:
        """Raise an error if a build of the bank is no shock, or cannot be coupled with the vehicle at its corner."""
        for name, build in bank.items():
            given = f"{name!r}, {self._folder / self._content.bank[name].fmu}"
            corner = next((corner for corner, allowed in corners.items() if name in allowed), "")
            shock = FmuComponent(build.fmu, corner or name)
            if fault := _not_a_shock(shock):
                raise InputError(f"bank: {given}, is no shock: {fault}; name a shock file or the FMU of a shock "
                                 "(docs/reference/ports.md)")  # fmt: skip
            if not corner:
                continue
            try:
                System({vehicle.name: car, corner: shock}, (bond_at(car, vehicle.name, corner, shock),),
                       parameters={corner: build.parameters})  # fmt: skip
            except WiringError as error:
                raise InputError(f"bank: {given}, cannot be coupled with the vehicle {self._content.vehicle.fmu}: "
                                 f"{error}; correct it, or name another shock") from error  # fmt: skip

    def _vehicle(self) -> tuple[Vehicle, FmuComponent]:
        part = self._content.vehicle
        source = self._folder / part.fmu
        fmu = self._fmu(source)
        car = FmuComponent(fmu, part.name)
        # A model of masses and springs has a valid steady state; one that was identified on a rig does not.
        trusted = part.means == "trusted" if part.means else source.suffix == ".toml"
        parameters = {name: _own(car, name, value) for name, value in part.parameters.items()}
        inputs = {name: float(_own(car, name, value)) for name, value in part.inputs.items()}
        return Vehicle(fmu, part.name, parameters, inputs, trusted), car

    def _build(self, name: str, part: _Part) -> Build:
        fmu = self._fmu(self._folder / part.fmu)
        if not part.parameters:
            return Build(fmu)
        shock = FmuComponent(fmu, name)
        return Build(fmu, {key: _own(shock, key, value) for key, value in part.parameters.items()})

    def _drive(self, drive: _Drive, vehicle: Vehicle, car: FmuComponent) -> Drive:
        file = self._folder / drive.file
        record = read_record(file)
        mapping = ChannelMap.read(self._folder / drive.channel_map) if drive.channel_map else map_beside(record)
        start = _si(drive.start, "drive.start", "s")
        stop = inf if drive.stop is None else _si(drive.stop, "drive.stop", "s")
        targets = drive.targets or _driven_by(record, mapping, vehicle, car)
        found = Drive(
            drive.name or file.stem, file, stop, start, drive.units, mapping.path if mapping else None, targets
        )
        return found if stop < inf else replace(found, stop=float(driving_channels(found).series.time[-1]) - start)

    def _measures(
        self,
        vehicle: Vehicle,
        car: FmuComponent,
        corners: tuple[str, ...],
        bank: Mapping[str, Build],
        drives: tuple[Drive, ...],
    ) -> tuple[Measure, ...]:
        """Return the measures of the families, on every drive, followed by the file's own."""
        shock = FmuComponent(next(iter(bank.values())).fmu, "shock") if bank else None
        parts = {vehicle.name: car, **(dict.fromkeys(corners, shock) if shock else {})}
        self._units = {f"{part}.{name}": to_si(variable)[1] for part, component in parts.items()
                       for name, variable in component.variables.items()}  # fmt: skip
        known = Car(vehicle.name, corners, set(self._units))
        common = [m for name in self._content.families for m in family(name, known)]
        common = [m for m in common if vehicle.means_trusted or not m.absolute]
        several = drives if len(drives) > 1 else ()
        spread = [replace(m, name=f"{d.name}: {m.name}", drive=d.name) for d in several for m in common] or common
        unique = {m.name: m for m in spread}
        return (*unique.values(), *(self._measure(m) for m in self._content.measure))

    def _measure(self, given: _Measure) -> Measure:
        what = f"measure {given.name!r}"
        function = given.function
        if function:
            file, colon, name = function.rpartition(":")
            function = f"{(self._folder / file).resolve()}{colon}{name}"
        return Measure(
            **given.model_dump(include={"name", "channels", "statistic", "display", "weights", "drive"}),
            band=_pair(given.band, f"{what}, band", "Hz"),
            section=_pair(given.section, f"{what}, section", "s"),
            options={
                key: _si(value, f"{what}, {key}", self._unit_of(key, given)) for key, value in given.options.items()
            },
            function=function,
            function_unit=given.unit,
        )

    def _unit_of(self, option: str, given: _Measure) -> str:
        """Return the unit of an option of a statistic, SI except percent; empty if it is not known."""
        if option == "percent":
            return "%"
        return self._units.get(given.channels[0], "") if given.statistic == "share" and given.channels else ""


def _driven_by(record: RawRecord, mapping: ChannelMap | None, vehicle: Vehicle, car: FmuComponent) -> dict[str, str]:
    """Return the input that each channel of a rig record drives; empty if the file has no measured channel.

    Outputs of the vehicle and the forces of its shocks are measured channels.
    """
    mapped = {name: pick.source for name, pick in mapping.channels.items()} if mapping else {}
    columns = {name: name for name in record.names if name not in mapped.values()} | mapped
    known = {name: variable for name, variable in car.variables.items() if name in columns}
    measured = {"force", *(f"{corner}.force" for corner in ports(car))}
    measured |= {name for name, variable in known.items() if variable.causality == "output"}
    if not measured & set(known):
        return {}
    inputs = [
        v for v in car.variables.values() if v.causality == "input" and v.name not in measured | {*vehicle.inputs}
    ]
    if missing := [v.name for v in inputs if v.name not in columns and v.type == "Real"]:
        raise InputError(
            f"drive: {record.origin.path} has no channel for {some(missing)}, inputs of the vehicle; name their "
            "columns in the channel map, or give constants in inputs of [vehicle]. The file has: "
            f"{', '.join(record.names)}"
        )
    driving = [v.name for v in inputs if v.name in columns]
    for name in driving:
        record.check_unique(columns[name], channel=name)
    return {name: f"{vehicle.name}.{name}" for name in driving}


def _not_a_shock(component: FmuComponent) -> str:
    """Return why a component is no shock; empty if it is one."""
    known = component.variables
    if missing := [quantity for quantity in ("velocity", "force") if quantity not in known]:
        return f"it has no {missing[0]}"
    if known["velocity"].causality != "input" or known["force"].causality == "input":
        causality = " and ".join(f"{name} is of causality {known[name].causality}" for name in ("velocity", "force"))
        return f"its {causality} (input and output in a shock)"
    return ""


def _term(term: _Term, measures: tuple[Measure, ...]) -> Term:
    shown = {m.name: m.display for m in measures}
    return Term(term.measure, term.weight, term.unit or shown.get(term.measure, ""))


def _constraint(given: _Constraint, measures: tuple[Measure, ...], channels: Mapping[str, str]) -> Constraint:
    what = f"constraint {given.measure!r}"
    known = {m.name: m.unit_for(channels.get(m.channels[0], "")) for m in measures}
    unit = known.get(given.measure, "")
    return Constraint(given.measure, _si(given.at_least, what, unit), _si(given.at_most, what, unit))


def _pair(pair: tuple[Value, Value] | None, what: str, si: str) -> tuple[float, float] | None:
    return None if pair is None else (_si(pair[0], what, si), _si(pair[1], what, si))


def _si(value: Value, what: str, si: str = "") -> float:
    """Return a number, or a value with its unit, in the SI unit `si`, or in its own SI unit if that is not known."""
    if not isinstance(value, str):
        return value
    try:
        number, unit = units.quantity(value)
        return units.convert(number, unit, si or units.si_unit(unit))
    except InputError as error:
        raise InputError(f"{what}: {error}, in the value {value!r}") from error


def _own(component: FmuComponent, name: str, value: bool | Value) -> bool | Value:
    variable: Variable | None = component.variables.get(name)
    if variable is None:
        raise WiringError(f"{component.source} has no variable {name!r}")
    if not isinstance(value, str) or variable.type != "Real":
        return value
    number, unit = units.quantity(value)
    return convert_between(named_unit(unit), variable.unit, f"{name} = {value!r}")(number)
