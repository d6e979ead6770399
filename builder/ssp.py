"""Export of a coupled system as an SSP 1.0 package for other tools (tests/builder/test_ssp.py).

The package contains SystemStructure.ssd (components, connections, units), resources/*.fmu, and for each component
resources/<component>.ssv with the values of its tunable parameters. To change a shock's setup, change only its .ssv
file. The .ssv files are bound to the components and not to the system, because libcosim and ecos only read those. Each
contains a parameter set named `setup`, so that `ecos simulate --parameterSet setup` applies all of them.
"""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from builder.interface import xml_document
from builder.reference import SECRET
from eightpost import __version__
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError, InputError, WiringError
from eightpost.fmi import Variable, read_description
from eightpost.wiring import Wire, Wiring

_NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}
SETUP = "setup"

Value = float | bool
_TYPES = ("Real", "Integer", "Boolean")
_CONNECTORS = ("Real", "Integer", "Boolean", "String")  # an enumeration's connector would need its items


@dataclass(frozen=True)
class _Fmu:
    """The data of an FMU that the package needs: its path in the package, its variables, its units."""

    member: str
    content: bytes
    variables: Mapping[str, Variable]
    units: Mapping[str, Mapping[str, str]]

    def unit(self, variable: Variable) -> dict[str, str]:
        """Return the attribute for a variable's unit; empty without a definition, which SSP requires of every unit."""
        return {"unit": variable.unit} if variable.unit and variable.unit in self.units else {}


def _setup_member(component: str) -> str:
    return f"resources/{component}.ssv"


def write_ssp(path: str | Path, wiring: Wiring) -> tuple[str, ...]:
    """Write the package; return the unconnected inputs, which the importing tool has to set.

    Args:
        path: Package to write.
        wiring: FMUs and connections; see `cosim.System.wiring`.

    Raises:
        FmuError: An FMU cannot be read.
        InputError: A value is neither a number nor true or false.
        WiringError: SSP 1.0 cannot represent the system: an input has two sources, a variable is unknown, or a
            variable with a value cannot be set.
    """
    if wiring.sums:
        raise WiringError(f"{min(wiring.sums)} adds up several sources: SSP 1.0 allows one source per input, no sums")
    values = {name: _numbers(name, wiring.values.get(name, {})) for name in wiring.fmus}
    given = {f"{component}.{name}" for component, own in values.items() for name in own}
    _refuse_two_sources(wiring.wires, given)
    fmus = _read_fmus(wiring.fmus)
    for wire in wiring.wires:
        _check_end(fmus, wire.source, "output")
        _check_end(fmus, wire.target, "input")
    members = {fmu.member: fmu.content for fmu in fmus.values()}
    members["SystemStructure.ssd"] = _document(_structure(wiring, fmus))
    for name, fmu in fmus.items():
        members[_setup_member(name)] = _document(_setup(name, values[name], fmu))
    write_archive(path, members)
    fed = given | {wire.target for wire in wiring.wires}
    return tuple(
        f"{component}.{v.name}"
        for component, fmu in fmus.items()
        for v in fmu.variables.values()
        if v.causality == "input" and f"{component}.{v.name}" not in fed
    )


def _numbers(component: str, values: Mapping[str, Value | str]) -> dict[str, Value]:
    numbers = {name: value for name, value in values.items() if not isinstance(value, str)}
    if words := sorted(set(values) - set(numbers)):
        raise InputError(f"{component}.{words[0]} is text; the package can hold only numbers and true or false")
    return numbers


def _refuse_two_sources(wires: Iterable[Wire], given: Iterable[str]) -> None:
    seen = dict.fromkeys(given, "a constant")
    for wire in wires:
        if other := seen.get(wire.target):
            raise WiringError(
                f"{wire.target} is connected to {other} and to {wire.source}: SSP 1.0 allows one source "
                "per input and no sums; remove one, or add a component that sums them"
            )
        seen[wire.target] = wire.source


def _read_fmus(files: Mapping[str, Path]) -> dict[str, _Fmu]:
    """Return the FMU of each component; files with equal content are stored once, others get different names."""
    stored: dict[str, bytes] = {}
    found = {}
    for component, file in files.items():
        content = file.read_bytes() if file.is_file() else b""
        members = read_archive(file)
        member = f"resources/{file.name}"
        if stored.setdefault(member, content) != content:
            digest = hashlib.sha256(content).hexdigest()[:8]
            member = f"resources/{file.stem}_{digest}.fmu"
            stored[member] = content
        found[component] = _fmu(file, member, content, members)
    return found


def _fmu(path: Path, member: str, content: bytes, members: Mapping[str, bytes]) -> _Fmu:
    try:
        root = ET.fromstring(members["modelDescription.xml"])
    except (KeyError, ET.ParseError) as error:
        raise FmuError(f"{path}: its modelDescription.xml is missing or cannot be read ({error})") from error
    description = read_description(root)
    units = {unit.name: unit.base for unit in description.units if unit.base is not None}
    return _Fmu(member, content, description.by_name, units)


def _check_end(fmus: Mapping[str, _Fmu], full_name: str, causality: str) -> None:
    component, _, name = full_name.partition(".")
    fmu = fmus.get(component)
    if fmu is None or name not in fmu.variables:
        raise WiringError(f"{full_name}: the variable does not exist; check the names of the system's components")
    variable = fmu.variables[name]
    if variable.causality != causality or variable.type not in _CONNECTORS:
        raise WiringError(
            f"{full_name} is a {variable.type} {variable.causality}: an SSP package only connects outputs to inputs, "
            f"of the types {', '.join(_CONNECTORS)}; connect an {causality}"
        )


def _tag(prefix: str, name: str) -> str:
    return f"{{{_NAMESPACES[prefix]}}}{name}"


def _child(parent: ET.Element, prefix: str, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, _tag(prefix, tag), attributes)


def _structure(wiring: Wiring, fmus: Mapping[str, _Fmu]) -> ET.Element:
    tool = f"eightpost {__version__}"
    root = ET.Element(_tag("ssd", "SystemStructureDescription"), name=wiring.name, version="1.0", generationTool=tool)
    top = _child(root, "ssd", "System", name=_identifier(wiring.name))
    elements = _child(top, "ssd", "Elements")
    for component, fmu in fmus.items():
        _component(elements, component, fmu)
    links = _child(top, "ssd", "Connections")
    for wire in wiring.wires:
        _connection(links, wire)
    # Without this annotation OMSimulator assumes a strongly coupled system, which cannot contain co-simulation FMUs.
    oms = _child(_annotation(top, "org.openmodelica"), "oms", "Annotations")
    _child(
        _child(oms, "oms", "SimulationInformation"), "oms", "FixedStepMaster",
        description="oms-ma", stepSize=repr(wiring.step), absoluteTolerance="0.0001", relativeTolerance="0.0001",
    )  # fmt: skip
    units = {name: base for fmu in fmus.values() for name, base in fmu.units.items()}
    _units(root, "ssd", units)
    experiment = _child(root, "ssd", "DefaultExperiment", startTime="0.0", stopTime=repr(wiring.stop))
    osp = _child(_annotation(experiment, "com.opensimulationplatform"), "osp", "Algorithm")
    _child(osp, "osp", "FixedStepAlgorithm", baseStepSize=repr(wiring.step))
    return root


def _identifier(name: str) -> str:
    """Return the name converted to an identifier, because OMSimulator requires one for a system."""
    near = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return near if near.isidentifier() else f"system_{near}"


def _annotation(parent: ET.Element, kind: str) -> ET.Element:
    return _child(_child(parent, "ssd", "Annotations"), "ssc", "Annotation", type=kind)


def _component(elements: ET.Element, name: str, fmu: _Fmu) -> None:
    kind = "application/x-fmu-sharedlibrary"
    element = _child(
        elements, "ssd", "Component", name=name, type=kind, source=fmu.member, implementation="CoSimulation"
    )
    connectors = _child(element, "ssd", "Connectors")
    for variable in fmu.variables.values():
        if variable.causality in ("input", "output", "parameter") and variable.type in _CONNECTORS:
            connector = _child(connectors, "ssd", "Connector", name=variable.name, kind=variable.causality)
            _child(connector, "ssc", variable.type, **fmu.unit(variable))
    source = _setup_member(name)
    _child(_child(element, "ssd", "ParameterBindings"), "ssd", "ParameterBinding", source=source)


def _connection(links: ET.Element, wire: Wire) -> None:
    (source, output), (target, into) = wire.places
    link = _child(
        links, "ssd", "Connection",
        startElement=source, startConnector=output, endElement=target, endConnector=into,
    )  # fmt: skip
    if wire.convert or wire.line != (1.0, 0.0):
        link.set("suppressUnitConversion", "true")  # the factor includes the unit conversion
        factor, offset = map(repr, wire.line)
        _child(link, "ssc", "LinearTransformation", factor=factor, offset=offset)


def _units(root: ET.Element, prefix: str, units: Mapping[str, Mapping[str, str]]) -> None:
    if units:
        parent = _child(root, prefix, "Units")
        for name in sorted(units):
            _child(_child(parent, "ssc", "Unit", name=name), "ssc", "BaseUnit", **units[name])


def _setup(component: str, values: Mapping[str, Value], fmu: _Fmu) -> ET.Element:
    """Return a component's parameter set: the given values, and the start values of all other tunable parameters."""
    tool = f"eightpost {__version__}"
    root = ET.Element(_tag("ssv", "ParameterSet"), name=SETUP, version="1.0", generationTool=tool)
    parent = _child(root, "ssv", "Parameters")
    used: dict[str, Mapping[str, str]] = {}
    for name, value in (_tunable(fmu) | dict(values)).items():
        variable = fmu.variables.get(name)
        if variable is None or variable.causality not in ("parameter", "input") or variable.type not in _TYPES:
            raise WiringError(
                f"{component}.{name} cannot be set: it is not a Real, Integer or Boolean parameter or input"
            )
        unit = fmu.unit(variable)
        used |= {name: fmu.units[name] for name in unit.values()}
        parameter = _child(parent, "ssv", "Parameter", name=name)
        _child(parameter, "ssv", variable.type, value=_text(value, variable.type), **unit)
    _units(root, "ssv", used)
    return root


def _tunable(fmu: _Fmu) -> dict[str, Value]:
    """Return the start values of the tunable parameters, except those of a shock's curve."""
    return {
        v.name: float(v.start)
        for v in fmu.variables.values()
        if v.causality == "parameter" and v.variability == "tunable" and v.type == "Real" and v.start is not None
        if not v.name.startswith(SECRET)
    }


def _text(value: Value, kind: str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return str(int(value)) if kind == "Integer" else repr(float(value))


def _document(root: ET.Element) -> bytes:
    for prefix, uri in _NAMESPACES.items():
        ET.register_namespace(prefix, uri)
    return xml_document(root)
