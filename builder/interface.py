"""Interface of an FMU: its variables from interface.toml, and modelDescription.xml (FMI 2.0.4 and 3.0.2)."""

from __future__ import annotations

import hashlib
import re
import tomllib
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from eightpost import __version__, units
from eightpost.corners import CORNERS
from eightpost.errors import FmuError
from eightpost.fmi import FLAGS
from eightpost.shock import Shock, ShockLaw, law_module
from eightpost.shock.curve import KNOTS
from eightpost.vehicle import StateSpace

#: A matrix of truths: which rows depend on which columns.
Terms = Any


def with_springs(
    terms: Terms, steady: Terms, model: StateSpace, ports: Sequence[str]
) -> tuple[Terms, list[tuple[str, ...]]]:
    """Return which values of the steady state depend on which inputs (k, m) and spring parameters, by name.

    Args:
        terms: Dependencies of the values on the inputs without springs (k, m).
        steady: The same of the outputs (p, m).
        model: Model of the vehicle.
        ports: Prefixes of the ports that can have a spring: "lf.", ..., or "" for a quarter car.
    """
    columns = [model.input_names.index(f"{port}force") for port in ports]
    moved = steady[[model.output_names.index(f"{port}displacement") for port in ports]]
    linked = np.eye(len(ports), dtype=bool) | moved[:, columns]
    for _ in ports:  # through any chain of springs
        linked = linked @ linked
    acting = terms[:, columns] @ linked
    return terms | (acting @ moved), [chosen([f"{port}port_spring" for port in ports], row) for row in acting]


def chosen(names: Sequence[str], row: Terms) -> tuple[str, ...]:
    """Return the names whose entry in a row of truths is true."""
    return tuple(name for name, term in zip(names, row, strict=True) if term)


# ---- Location of the FMUs' sources ----------------------------------------------------------------------------------

_PACKAGE = Path(__file__).parent


def source_folder() -> Path:
    """Return the folder that contains common/, shock_lpnl2/, vehicle_ss/ and so on.

    Raises:
        FmuError: The folder does not exist; the installation is broken.
    """
    for folder in (_PACKAGE / "fmus", _PACKAGE.parent / "fmus"):
        if (folder / "vehicle_ss" / "interface.toml").is_file():
            return folder
    raise FmuError(f"there is no fmus/ folder inside or next to {_PACKAGE}; reinstall eightpost")


def source_files(folder: str) -> dict[str, bytes]:
    """Return the C files in a folder of fmus/: name -> content."""
    files = sorted((source_folder() / folder).iterdir())
    return {file.name: file.read_bytes() for file in files if file.suffix in (".c", ".h", ".inc")}


def shock_kinds() -> tuple[str, ...]:
    """Return the names of the shock interfaces: the folders fmus/shock_<law>/."""
    return tuple(sorted(path.parent.name for path in source_folder().glob("shock_*/interface.toml")))


# ---- The interface of an FMU ----------------------------------------------------------------------------------------


#: Parameters of friction and springs at a vehicle's ports.
PORT_PARAMETERS = (
    "friction_force", "friction_velocity", "bristle_force", "bristle_reach", "bristle_static_ratio",
    "bristle_stribeck_velocity", "port_spring",
)  # fmt: skip

#: Name of a bristle's state, after the prefix of its port.
BRISTLE = "bristle_deflection"

#: Units of quantities that are zero in any steady state.
RATES = ("m/s", "rad/s", "m/s2")

_KEYS = {
    "name", "reference", "type", "causality", "variability", "unit", "display", "start", "min", "max", "size",
    "description", "offset", "with", "at_start", "derivative_of", "nominal",
}  # fmt: skip

#: Name of a vehicle's continuous states: `mode.real[1]`, `mode.imaginary[1]`, `lf.bristle_deflection`, in an assembly
#: with the vehicle's name before it.
_VEHICLE_STATE = re.compile(r"(?:\w+\.)?mode\.(?:real|imaginary)\[\d+\]|(?:\w+\.){0,2}bristle_deflection")


#: Parameters of a curve that have no effect if it has knots.
_POLYNOMIALS = re.compile(r"curve\.(?:inner\[|compression\[|rebound\[|transition_)")

#: Where the last knot is not at 0, a curve has knots. An FMU that is built with knots does not accept to lose them, so
#: that it never depends on the polynomials.
_LAST_KNOT, _LEAST_SPEED = f"curve.knot_velocity[{KNOTS}]", 1e-6


@dataclass(frozen=True)
class Variable:
    """One scalar variable of an FMU.

    `offset` is the name of the parameter that is added to an output, `derivative_of` the continuous state whose
    derivative the variable is, and `nominal` the typical size of a continuous state.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    unit: str | None
    display: str | None
    start: float | bool | None
    minimum: float | None
    maximum: float | None
    description: str
    offset: str | None = None
    derivative_of: str | None = None
    nominal: float | None = None

    @property
    def is_computed(self) -> bool:
        """Whether it has no place in the C core's table of values: derivatives, and the states of a vehicle."""
        return self.derivative_of is not None or _VEHICLE_STATE.fullmatch(self.name) is not None

    @property
    def initial(self) -> str | None:
        """FMI's attribute `initial`: exact for parameters, calculated for outputs and locals, absent for inputs."""
        return {"parameter": "exact", "output": "calculated", "local": "calculated"}.get(self.causality)


@dataclass(frozen=True)
class Interface:
    """All variables of one FMU and the dependencies of each output and derivative.

    `direct` lists for each output and derivative the inputs with feedthrough to it and the continuous states that it
    depends on, `initial` all variables that the initial value of an output, state or derivative depends on.
    """

    kind: str
    version: str
    description: str
    variables: tuple[Variable, ...]
    direct: Mapping[str, tuple[str, ...]]
    initial: Mapping[str, tuple[str, ...]]

    def names(self, causality: str) -> tuple[str, ...]:
        """Return the names of all variables of a causality, in order."""
        return tuple(v.name for v in self.variables if v.causality == causality)

    @property
    def derivatives(self) -> tuple[str, ...]:
        """Names of the derivatives of the continuous states, in order."""
        return tuple(v.name for v in self.variables if v.derivative_of is not None)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the continuous states, in the order of their derivatives."""
        return tuple(v.derivative_of for v in self.variables if v.derivative_of is not None)

    def feedthrough(self, name: str) -> tuple[str, ...]:
        """Return the inputs with feedthrough to an output or derivative."""
        inputs = set(self.names("input"))
        return tuple(known for known in self.direct.get(name, ()) if known in inputs)

    def without_states(self) -> Interface:
        """Return the interface without continuous states, for an FMU that offers co-simulation only."""
        hidden = set(self.derivatives) | {v.name for v in self.variables if v.is_computed}
        outputs = self.names("output")
        return replace(
            self,
            variables=tuple(replace(v, nominal=None) for v in self.variables if v.name not in hidden),
            direct={name: self.feedthrough(name) for name in outputs},
            initial={name: self.initial[name] for name in outputs},
        )


def own_value(law: type[ShockLaw], name: str, values: Mapping[str, float]) -> float | tuple[float, ...]:
    """Return one of a law's own parameters, given the values of an FMU's variables; a tuple has several."""
    sizes: Mapping[str, int] = getattr(law_module(law), "SIZES", {})
    if name not in sizes:
        return values[name]
    prefix = name if f"{name}[1]" in values else f"curve.{name}"
    return tuple(values[f"{prefix}[{k + 1}]"] for k in range(sizes[name]))


def shock_interface(shock: Shock) -> Interface:
    """Return the interface of a shock FMU; the shock's parameters are the start values."""
    table = read_table(f"shock_{shock.law_name}")
    rows = [row for row in table["variable"] if row["name"] not in table.get("without", ())]
    variables = tuple(v for row in rows for v in _sized_variables(row, shock.law))
    # The start is an equilibrium, so parameters that only affect how the lag develops have no influence on it.
    idle = {row["name"] for row in table["variable"] if not row.get("at_start", True)}
    if shock.law.curve.has_knots:
        idle |= {v.name for v in variables if _POLYNOMIALS.match(v.name)}
        variables = tuple(replace(v, minimum=_LEAST_SPEED) if v.name == _LAST_KNOT else v for v in variables)
    idle |= {v.name for v in variables if v.name.partition("[")[0] in idle}
    parameters = tuple(v.name for v in variables if v.causality == "parameter" and v.name not in idle)
    inputs = tuple(v.name for v in variables if v.causality == "input")
    started = [v.name for v in variables if v.name not in idle]
    starts = {  # what the initial value of a state depends on; a name ending in `*` stands for all that begin with it
        name: tuple(other for other in started if any(fnmatchcase(other, pattern) for pattern in patterns))
        for name, patterns in table["start_dependencies"].items()
    }
    interface = Interface(
        kind=table["interface"],
        version=table["version"],
        description=table["description"],
        variables=variables,
        direct={},
        initial={"force": inputs + parameters},
    )
    known, rates = {*inputs, *interface.states}, interface.derivatives
    return replace(
        interface,
        direct={name: tuple(n for n in table["dependencies"][name] if n in known) for name in ("force", *rates)},
        initial=dict(interface.initial) | {name: starts.get(name, ()) for name in (*interface.states, *rates)},
    )


def vehicle_interface(model: StateSpace) -> Interface:
    """Return the interface of a vehicle FMU: the rows of vehicle_ss that match the channels of its model.

    Raises:
        FmuError: A channel of the model matches no row, has a different unit, or is an output instead of an input (or
            the reverse).
    """
    table = read_table("vehicle_ss")
    channels = {c.name: ("input", c.unit) for c in model.inputs} | {c.name: ("output", c.unit) for c in model.outputs}
    direct = model.direct_terms()
    fed = {c.name for c, terms in zip(model.outputs, direct, strict=True) if terms.any()}
    partners = {name for name in channels if name not in fed or name.rpartition(".")[2] != "displacement"}
    rows = [row for row in table["variable"] if "<mode>" not in row["name"]]  # builder/product.py
    variables = tuple(v for row in rows for v in _corner_variables(row) if _is_included(row, v, channels, partners))
    _check_channels(model.name, channels, variables)
    names = model.input_names
    interface = Interface(
        kind=table["interface"],
        version=table["version"],
        description=table["description"],
        variables=variables,
        direct={channel.name: chosen(names, row) for channel, row in zip(model.outputs, direct, strict=True)},
        initial={},
    )
    steady, offsets, initial = steady_terms(model), {v.name: v.offset for v in variables}, {}
    at_start, springs = with_springs(steady, steady, model, spring_ports(interface))
    for channel, row, own in zip(model.outputs, direct | at_start, springs, strict=True):
        known, offset = chosen(names, row), offsets[channel.name]
        flag = ["start_at_equilibrium"] if known else []
        initial[channel.name] = (*known, *([offset] if offset else []), *flag, *own)
    return replace(interface, initial=initial)


def friction_ports(interface: Interface) -> tuple[str, ...]:
    """Return the prefixes of the ports that have suspension friction, in order: "lf.", ..., or "" for a quarter car."""
    last = "friction_force"
    return tuple(v.name.removesuffix(last) for v in interface.variables if v.name.endswith(last))


def spring_ports(interface: Interface) -> tuple[str, ...]:
    """Return the prefixes of the ports that can have a progressive spring, in order."""
    last = "port_spring"
    return tuple(v.name.removesuffix(last) for v in interface.variables if v.name.endswith(last))


def read_table(folder: str) -> dict[str, Any]:
    """Return interface.toml of a folder of fmus/, merged with the table that it extends.

    Raises:
        FmuError: A row has an unknown key.
    """
    path = source_folder() / folder / "interface.toml"
    table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    if base := table.get("extends"):
        common = tomllib.loads((path.parent / base).read_text(encoding="utf-8"))
        table["variable"] = common["variable"] + table.get("variable", [])
        for section in ("dependencies", "start_dependencies"):
            table[section] = common.get(section, {}) | table.get(section, {})
    for row in table["variable"]:
        if unknown := sorted(set(row) - _KEYS):
            raise FmuError(f"{path}: {row.get('name')}: unknown keys: {', '.join(unknown)}")
    return table


def variable_of(row: Mapping[str, Any], name: str, reference: int, start: Any, offset: str | None = None) -> Variable:
    """Return the variable that a row of interface.toml describes."""
    return Variable(
        name=name,
        reference=reference,
        type=row.get("type", "Real"),
        causality=row["causality"],
        variability=row.get("variability", "continuous"),
        unit=row.get("unit"),
        display=row.get("display"),
        start=0.0 if start is None and row["causality"] == "input" else start,
        minimum=row.get("min"),
        maximum=row.get("max"),
        description=row["description"],
        offset=offset,
        derivative_of=row.get("derivative_of"),
        nominal=row.get("nominal"),
    )


def _sized_variables(row: Mapping[str, Any], law: Any) -> Sequence[Variable]:
    """Return a row's variables with start values from the law; a row with a size becomes name[1], name[2], ..."""
    start = attrgetter(row["start"])(law) if "start" in row else None
    if "size" not in row:
        return [variable_of(row, row["name"], row["reference"], start)]
    assert start is not None and len(start) == row["size"]
    return [variable_of(row, f"{row['name']}[{k + 1}]", row["reference"] + k, start[k]) for k in range(row["size"])]


def _corner_variables(row: Mapping[str, Any]) -> Sequence[Variable]:
    """Return a row's variables: a row with <corner> becomes one per corner, and one without corner (quarter car)."""
    name, start, offset = row["name"], row.get("start"), row.get("offset")
    if "<corner>" not in name:
        return [variable_of(row, name, row["reference"], start, offset)]
    variables = []
    for k, prefix in enumerate([*(f"{corner}." for corner in CORNERS), ""]):
        own, added = name.replace("<corner>.", prefix), offset and offset.replace("<corner>.", prefix)
        variables.append(variable_of(row, own, row["reference"] + k % len(CORNERS), start, added))
    return variables


def _is_included(
    row: Mapping[str, Any], variable: Variable, channels: Mapping[str, tuple[str, str]], known: Set[str]
) -> bool:
    """Return whether a model with some channels has a variable; `known` are the channels that `with` may name."""
    if variable.causality != "parameter":
        return variable.name in channels
    if "with" not in row:
        return True
    corner, dot, _ = variable.name.rpartition(".")
    partners = [row["with"]] if isinstance(row["with"], str) else row["with"]
    return all(partner.replace("<corner>.", corner + dot) in known for partner in partners)


def _check_channels(model: str, channels: Mapping[str, tuple[str, str]], variables: Sequence[Variable]) -> None:
    known = {v.name: (v.causality, v.unit) for v in variables}
    for name, (side, unit) in channels.items():
        if known.get(name) != (side, unit):
            raise FmuError(
                f"vehicle {model!r}: the {side} {name!r} [{unit}] is not a variable of vehicle_ss; "
                "docs/reference/ports.md lists the inputs and outputs with their units. Rename the channel, or leave "
                "it out of the model"
            )


def steady_terms(model: StateSpace) -> Terms:
    """Return whether each output's steady state depends on each input (p, m); all true if there is no steady state.

    At rest, velocities are zero, and so are the accelerations of a physical model, up to rounding of their terms. Those
    of a model that was fitted to responses may have small constant parts, which count.
    """
    try:
        gain = model.dc_gain()
    except ValueError:
        return np.ones(model.D.shape, dtype=bool)
    units = np.array([channel.unit for channel in model.outputs])[:, None]
    acceleration, rate = units == "m/s2", np.isin(units, list(RATES))
    # Where direct term and response of the states cancel, only rounding remains.
    scale = np.where(acceleration, np.abs(model.D), np.abs(gain).max(axis=1, keepdims=True))
    return np.asarray((np.abs(gain) > 1e-9 * scale) & (~rate | (acceleration & (model.D != 0.0))))


# ==== Generation of modelDescription.xml from an interface (FMI 2.0.4 and 3.0.2, Co-Simulation and Model Exchange) ===

_LOG_CATEGORIES = {
    "logStatusWarning": "Unusual calls that were carried out",
    "logStatusDiscard": "Results that could not be computed",
    "logStatusError": "Calls that were refused, with the reason",
    "logStatusFatal": "Errors after which the instance cannot be used",
    "logAll": "All messages",
}


_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "fmu.eightpost")


_ABOUT = {"author": "eightpost", "version": __version__, "license": "MIT"}

#: The default experiment [s].
_EXPERIMENT = {"startTime": "0.0", "stopTime": "30.0", "stepSize": "0.001"}

#: The independent variable of FMI 3.0; its value reference is that in fmus/fmi3/fmi3_instance.h.
_TIME = Variable(
    name="time", reference=1000000, type="Real", causality="independent", variability="continuous", unit="s",
    display=None, start=None, minimum=None, maximum=None, description="Simulation time",
)  # fmt: skip

#: Capabilities of FMI 2.0 by their names in FMI 3.0.
_RENAMED = {
    **{name: name for name in ("needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess")},
    "canHandleVariableCommunicationStepSize": "canHandleVariableCommunicationStepSize",
    **{name: old for name, old in FLAGS.items() if name != "providesIntermediateUpdate"},
    "providesAdjointDerivatives": "providesDirectionalDerivative",
}
_TYPES = {"Real": "Float64", "Boolean": "Boolean"}


def model_description(
    identifier: str,
    text: str,
    interface: Interface,
    *,
    tool: str,
    kinds: Mapping[str, Mapping[str, str]],
    source_files: Sequence[str] = (),
    guid: str = "",
    fmi: int = 2,
) -> bytes:
    """Return modelDescription.xml of FMI 2.0 or 3.0; the same arguments give the same bytes.

    The variables and their value references are the same in both versions; FMI 3.0 adds the variable `time`.

    Args:
        identifier: Model identifier and model name.
        text: Description of the model.
        interface: Variables and their dependencies.
        tool: Name and version of the tools that built the FMU.
        kinds: Attributes of the elements ModelExchange and CoSimulation, which say what the FMU offers.
        source_files: Names of the C files in sources/ that a rebuild compiles.
        guid: GUID, without braces.
        fmi: FMI version, 2 or 3.
    """
    is_3 = fmi == 3
    variables = (_TIME, *interface.variables) if is_3 else interface.variables
    head = {"fmiVersion": "3.0" if is_3 else "2.0", "modelName": identifier}
    head |= {"instantiationToken" if is_3 else "guid": f"{{{guid}}}", "description": text, **_ABOUT}
    head |= {"generationTool": tool, "variableNamingConvention": "structured"}
    root = ET.Element("fmiModelDescription", head | ({} if is_3 else {"numberOfEventIndicators": "0"}))
    for kind, flags in kinds.items():
        own = _flags_3(kind, flags) if is_3 else flags
        element = ET.SubElement(root, kind, {"modelIdentifier": identifier, **own})
        if source_files and not is_3:  # FMI 3.0 lists them in buildDescription.xml
            files = ET.SubElement(element, "SourceFiles")
            for file in source_files:
                ET.SubElement(files, "File", name=file)
    _unit_definitions(root, variables)
    categories = ET.SubElement(root, "LogCategories")
    for name, meaning in _LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=meaning)
    ET.SubElement(root, "DefaultExperiment", _EXPERIMENT)
    note = ET.Element("Interface", name=interface.kind, version=interface.version)
    number = {v.name: v.reference if is_3 else position for position, v in enumerate(variables, start=1)}
    if not is_3:
        ET.SubElement(ET.SubElement(root, "VendorAnnotations"), "Tool", name="eightpost").append(note)
    _variables(root, variables, number, is_3)
    _structure(root, interface, number, is_3)
    if is_3:
        ET.SubElement(ET.SubElement(root, "Annotations"), "Annotation", type="eightpost").append(note)
    return xml_document(root)


def xml_document(root: ET.Element) -> bytes:
    """Return an indented document in UTF-8."""
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def content_guid(description: bytes, members: Mapping[str, bytes]) -> str:
    """Return a GUID that is a digest of modelDescription.xml without GUID and of all other members of the archive."""
    digest = hashlib.sha256(description)
    for name in sorted(members):
        digest.update(name.encode() + b"\0" + hashlib.sha256(members[name]).digest())
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))


def _flags_3(kind: str, flags: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of FMI 3.0; inputs that FMI 2.0 interpolates with derivatives come from updates."""
    found = {name: flags[old] for name, old in _RENAMED.items() if old in flags}
    if kind == "ModelExchange":
        needed = {"true": "false", "false": "true"}[flags["completedIntegratorStepNotNeeded"]]
        return found | {"needsCompletedIntegratorStep": needed}
    return found | {
        "providesIntermediateUpdate": flags["canInterpolateInputs"],
        "recommendedIntermediateInputSmoothness": "0",  # the inputs are piecewise linear: continuous, with kinks
        "hasEventMode": "false",
    }


def _unit_definitions(root: ET.Element, variables: Iterable[Variable]) -> None:
    displays: dict[str, set[str]] = {}
    for variable in variables:
        if variable.unit:
            displays.setdefault(variable.unit, set()).update({variable.display} if variable.display else ())
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted(displays):
        element = ET.SubElement(definitions, "Unit", name=unit)
        attributes = {base: str(power) for base, power in units.si_exponents(unit).items()}
        factor, _ = units.conversion(unit, units.si_unit(unit))
        ET.SubElement(element, "BaseUnit", attributes | ({"factor": repr(factor)} if factor != 1.0 else {}))
        for display in sorted(displays[unit]):
            factor, offset = units.conversion(unit, display)
            attributes = {"name": display, "factor": repr(factor)} | ({"offset": repr(offset)} if offset else {})
            ET.SubElement(element, "DisplayUnit", attributes)


def _variables(root: ET.Element, variables: Iterable[Variable], number: Mapping[str, int], is_3: bool) -> None:
    """Add the variables; `number` identifies them: by position in FMI 2.0, by value reference in FMI 3.0."""
    parent = ET.SubElement(root, "ModelVariables")
    for variable in variables:
        attributes = {
            "name": variable.name,
            "valueReference": str(variable.reference),
            "description": variable.description,
            "causality": variable.causality,
            "variability": variable.variability,
        }
        attributes |= {"initial": variable.initial} if variable.initial else {}
        of = {} if variable.derivative_of is None else {"derivative": str(number[variable.derivative_of])}
        if is_3:
            attributes |= {"intermediateUpdate": "true"} if variable.causality == "input" else {}
            ET.SubElement(parent, _TYPES[variable.type], attributes | of | _typed(variable))
        else:
            ET.SubElement(ET.SubElement(parent, "ScalarVariable", attributes), variable.type, _typed(variable) | of)


def _typed(variable: Variable) -> dict[str, str]:
    """Return the attributes of a variable that follow from its type: unit, range, start value."""
    values = {
        "unit": variable.unit,
        "displayUnit": variable.display,
        "min": variable.minimum,
        "max": variable.maximum,
        "nominal": variable.nominal,
        "start": variable.start,
    }
    return {name: _text(value) for name, value in values.items() if value is not None}


def _text(value: str | float | bool) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else repr(float(value))


def _structure(root: ET.Element, interface: Interface, number: Mapping[str, int], is_3: bool) -> None:
    parent = ET.SubElement(root, "ModelStructure")
    outputs, derivatives, place = interface.names("output"), interface.derivatives, list(number).index
    starts = sorted({*outputs, *interface.states, *derivatives}, key=place)
    for section, name_3, names, depends in (
        ("Outputs", "Output", outputs, interface.direct),
        ("Derivatives", "ContinuousStateDerivative", derivatives, interface.direct),
        ("InitialUnknowns", "InitialUnknown", starts, interface.initial),
    ):
        if section == "Derivatives" and not names:
            continue
        group = parent if is_3 else ET.SubElement(parent, section)
        for name in names:
            known = sorted(number[other] for other in depends[name])
            attributes = {
                "valueReference" if is_3 else "index": str(number[name]),
                "dependencies": " ".join(map(str, known)),
                "dependenciesKind": " ".join(["dependent"] * len(known)),
            }
            ET.SubElement(group, name_3 if is_3 else "Unknown", attributes)
