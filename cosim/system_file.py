"""System files (TOML): components, connections and scenario of a run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from cosim.components.component import Component
from cosim.components.fmu_component import FmuComponent
from cosim.components.isolated import IsolatedComponent
from cosim.session.run import PERCENT, Case
from cosim.ssp import SUFFIXES, Given, read_ssp
from cosim.systems.algorithm import SCHEMES, Algorithm, Automatic
from cosim.systems.coupling import Scenario
from cosim.systems.system import Bond, Connection, System, own_unit
from eightpost import units
from eightpost.errors import FmuError, InputError, UnknownUnitError, WiringError
from eightpost.files import read_text
from eightpost.signals import ChannelMap, Drivefile
from eightpost.toml_document import parse_model

# ---- Opening of an FMU as a component, in this process or in its own ------------------------------------------------


def open_component(
    path: str | Path, name: str, *, isolate: bool = False, compile_missing: bool = False
) -> FmuComponent | IsolatedComponent:
    """Open an FMU.

    Args:
        path: FMU file (.fmu).
        name: Name of the component.
        isolate: Whether to run it in its own process, where a crash or hang is a failed step.
        compile_missing: Whether to compile its sources if it has no binary for this platform.

    Raises:
        FmuError: The file is missing, damaged or unsafe, is not an FMU of FMI 2.0 or 3.0 for co-simulation, or has no
            binary for this platform.
    """
    kind = IsolatedComponent if isolate else FmuComponent
    return kind(path, name, compile_missing=compile_missing)


# ---- System files ---------------------------------------------------------------------------------------------------

SCHEMA = 1

#: Number in the variable's own unit (SI for times), or a value with its unit: "55 lbf".
Value = float | str


#: Messages for pydantic's error types.
_WORDS = {
    "extra_forbidden": "is not an entry of a system file (docs/reference/system_file.md lists them)",
    "tuple_type": "must be a list of tables: write [[bond]] or [[connection]] with two brackets",
}


#: Options of algorithms in the file: option -> algorithm -> name of its field.
_FIELDS: Mapping[str, Mapping[str, str]] = {
    "sequence": {"gauss-seidel": "sequence", "implicit": "sequence"},
    "values": {"gauss-seidel": "values", "jacobi": "values"},
    "tolerance": {"default": "tolerance", "adaptive": "relative"},
}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Component(_Strict):
    fmu: str
    parameters: dict[str, bool | Value] = Field(default_factory=dict)
    inputs: dict[str, bool | Value] = Field(default_factory=dict)


class _Bond(_Strict):
    between: tuple[str, str]
    gain: float = 1.0
    displacement: bool = True
    name: str | None = None


class _Connection(_Strict):
    source: str = Field(alias="from")
    target: str = Field(alias="to")
    gain: float = 1.0
    convert: bool = False


class _Scenario(_Strict):
    stop: Value
    drivefile: str | None = None
    drive_start: Value = 0.0
    units: dict[str, str] = Field(default_factory=dict)
    channel_map: str | None = None
    targets: dict[str, str] = Field(default_factory=dict)
    coupling_step: Value | None = None
    algorithm: Literal["default", "jacobi", "gauss-seidel", "implicit", "adaptive"] | None = None
    values: Literal["held", "interpolated", "extrapolated", "parabolic"] | None = None
    tolerance: float | None = None
    sequence: tuple[str, ...] = ()
    record: tuple[str, ...] = ()
    record_step: Value | None = None
    settling: Value = 0.0


class _File(_Strict):
    schema_: int = Field(alias="schema")
    name: str = ""
    components: dict[str, _Component]
    bond: tuple[_Bond, ...] = ()
    connection: tuple[_Connection, ...] = ()
    sums: tuple[str, ...] = ()
    scenario: _Scenario
    units: Literal["us", "si", "file", ""] = ""


def read_case(
    path: str | Path,
    *,
    fmus: Mapping[str, str | Path] | None = None,
    given: Given | None = None,
    isolate: bool = False,
    compile_missing: bool = False,
) -> Case:
    """Read a system file, or an SSP package (docs/how_to/ssp.md); paths in it are relative to it.

    Args:
        path: A TOML file, an .ssp archive or an .ssd description.
        fmus: FMUs by component name that replace those in the file, for example to swap a shock.
        given: Run data that a package lacks; a system file contains it.
        isolate: Whether each FMU runs in its own process (docs/how_to/foreign_fmus.md).
        compile_missing: Whether to compile the sources of an FMU that has no binary for this platform.

    Raises:
        InputError: The file cannot be read, an entry is unknown, missing or of the wrong kind; the message names it.
        WiringError: The system does not fit together.
        FmuError: An FMU cannot be used.
    """
    path = Path(path)
    load = partial(open_component, isolate=isolate, compile_missing=compile_missing)
    if path.suffix.lower() in SUFFIXES:
        return read_ssp(path, fmus=fmus, given=given, load=load)
    if given not in (None, Given()):
        raise InputError(
            f"{path}: a drive file, stop time, record step or input is given on the command line, but a system file "
            "contains these: change them there ([scenario], [components.NAME] inputs)"
        )
    content = parse_model(_File, read_text(path), path, SCHEMA, _WORDS)
    units.state(content.units)
    fmus = fmus or {}
    if unknown := sorted(set(fmus) - set(content.components)):
        raise WiringError(f"{path}: no component {unknown[0]!r} to swap; there are {', '.join(content.components)}")
    folder = path.parent
    files = {name: Path(fmus.get(name, folder / entry.fmu)) for name, entry in content.components.items()}
    components: dict[str, Component] = {}
    for name, file in files.items():
        try:
            components[name] = load(file, name)
        except FmuError as error:
            raise FmuError(f"{path}: components.{name}: {error}") from error
    try:
        system, scenario = _system(content, components), _scenario(path, content.scenario)
        step, algorithm = content.scenario.coupling_step, _algorithm(content.scenario)
        step = None if step is None else _seconds("coupling_step", step)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    return Case(
        name=content.name or path.stem, system=system, scenario=scenario, algorithm=algorithm, step=step, fmus=files
    )


def _system(content: _File, components: Mapping[str, Component]) -> System:
    entries = content.components
    return System(
        components=components,
        bonds=tuple(
            Bond.between(*b.between, gain=b.gain, displacement=b.displacement, name=b.name) for b in content.bond
        ),
        connections=tuple(Connection(c.source, c.target, c.gain, convert=c.convert) for c in content.connection),
        sums=frozenset(content.sums),
        constants={
            f"{name}.{variable}": _number(own_unit(components, f"{name}.{variable}", value), f"{name}.{variable}")
            for name, entry in entries.items()
            for variable, value in entry.inputs.items()
        },
        parameters={
            name: {
                variable: own_unit(components, f"{name}.{variable}", value) for variable, value in e.parameters.items()
            }
            for name, e in entries.items()
        },
    )


def _number(value: bool | float | str, name: str) -> float:
    if isinstance(value, str):
        raise WiringError(f"{name} = {value!r}: an input takes a number, or true or false")
    return value


def _scenario(path: Path, content: _Scenario) -> Scenario:
    folder = path.parent
    mapping = ChannelMap.read(folder / content.channel_map) if content.channel_map else None
    drive = (
        Drivefile.read(folder / content.drivefile, channel_map=mapping, units=content.units)
        if content.drivefile
        else None
    )
    record_step = content.record_step
    return Scenario(
        stop=_seconds("stop", content.stop),
        drive=drive,
        targets=content.targets,
        record=content.record,
        record_step=None if record_step is None else _seconds("record_step", record_step),
        settling=_seconds("settling", content.settling),
        drive_start=_seconds("drive_start", content.drive_start),
    )


def _algorithm(content: _Scenario) -> Algorithm | Automatic:
    name = content.algorithm or "default"
    chosen = SCHEMES[name]
    options: dict[str, Any] = {}
    for option, fields in _FIELDS.items():
        if (value := getattr(content, option)) is None or value == ():
            continue
        if name not in fields:
            fitting = ", ".join(fields)
            raise InputError(f"scenario.{option}: {name} has no such option, only {fitting}; remove one of the two")
        options[fields[name]] = PERCENT * value if fields[name] == "relative" else value
    return type(chosen)(**options)


def _seconds(key: str, value: Value) -> float:
    if not isinstance(value, str):
        return value
    try:
        number, unit = units.quantity(value)
        return units.convert(number, unit, "s")
    except UnknownUnitError as error:
        raise InputError(f"scenario.{key}: {error}") from error
