"""Generation of modelDescription.xml from an interface (FMI 2.0.4, Co-Simulation and Model Exchange)."""

from __future__ import annotations

import hashlib
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from builder.fmu.interface import Interface, Variable
from eightpost import __version__, units

_LOG_CATEGORIES = {
    "logStatusWarning": "Unusual calls that were carried out",
    "logStatusDiscard": "Results that could not be computed",
    "logStatusError": "Calls that were refused, with the reason",
    "logStatusFatal": "Errors after which the instance cannot be used",
    "logAll": "All messages",
}


_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "fmu.eightpost")


@dataclass(frozen=True)
class Description:
    """Content of modelDescription.xml: the interface and everything else."""

    identifier: str  #: Model identifier and model name.
    guid: str  #: GUID, without braces.
    text: str  #: Description of the model.
    interface: Interface  #: Variables and their dependencies.
    capabilities: Mapping[str, str]  #: Attributes of the CoSimulation element.
    generation_tool: str  #: Name and version of the tools that built the FMU.
    source_files: tuple[str, ...] = ()  #: Names of the C files in sources/ that a rebuild compiles.
    #: Attributes of the ModelExchange element; None for an FMU that offers co-simulation only.
    exchange: Mapping[str, str] | None = None
    stop_time: float = 30.0  #: Stop time of the default experiment [s].
    step_size: float = 1e-3  #: Step size of the default experiment [s].


def model_description(description: Description) -> bytes:
    """Return modelDescription.xml; the same description gives the same bytes."""
    interface = description.interface
    root = root_element("2.0", "guid", description)
    root.set("numberOfEventIndicators", "0")
    for kind, attributes in (("ModelExchange", description.exchange), ("CoSimulation", description.capabilities)):
        if attributes is not None:
            _kind(ET.SubElement(root, kind, {"modelIdentifier": description.identifier, **attributes}), description)
    add_environment(root, description, interface.variables)
    annotations = ET.SubElement(root, "VendorAnnotations")
    tool = ET.SubElement(annotations, "Tool", name="eightpost")
    ET.SubElement(tool, "Interface", name=interface.kind, version=interface.version)
    _model_variables(root, interface.variables)
    _model_structure(root, interface)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def root_element(version: str, token: str, description: Description) -> ET.Element:
    """Return the root element of an FMI version, with the GUID in the attribute `token`."""
    named = {"fmiVersion": version, "modelName": description.identifier, token: f"{{{description.guid}}}"}
    return ET.Element(
        "fmiModelDescription",
        named,
        description=description.text,
        author="eightpost",
        version=__version__,
        license="MIT",
        generationTool=description.generation_tool,
        variableNamingConvention="structured",
    )


def add_environment(root: ET.Element, description: Description, variables: Iterable[Variable]) -> None:
    """Add what both FMI versions write alike: units of the variables, log categories and the default experiment."""
    _unit_definitions(root, variables)
    categories = ET.SubElement(root, "LogCategories")
    for name, text in _LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=text)
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(description.stop_time),
        stepSize=repr(description.step_size),
    )


def content_guid(description: bytes, members: Mapping[str, bytes]) -> str:
    """Return a GUID that is a digest of modelDescription.xml without GUID and of all other members of the archive."""
    digest = hashlib.sha256(description)
    for name in sorted(members):
        digest.update(name.encode() + b"\0" + hashlib.sha256(members[name]).digest())
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))


def _kind(element: ET.Element, description: Description) -> None:
    if description.source_files:
        files = ET.SubElement(element, "SourceFiles")
        for file in description.source_files:
            ET.SubElement(files, "File", name=file)


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


def _model_variables(root: ET.Element, variables: Sequence[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    index = {variable.name: str(position) for position, variable in enumerate(variables, start=1)}
    for variable in variables:
        attributes = {
            "name": variable.name,
            "valueReference": str(variable.reference),
            "description": variable.description,
            "causality": variable.causality,
            "variability": variable.variability,
        }
        if variable.initial:
            attributes["initial"] = variable.initial
        of = {} if variable.derivative_of is None else {"derivative": index[variable.derivative_of]}
        element = ET.SubElement(parent, "ScalarVariable", attributes)
        ET.SubElement(element, variable.type, type_attributes(variable) | of)


def type_attributes(variable: Variable) -> dict[str, str]:
    """Return the attributes that both FMI versions give a variable because of its type: unit, range, start value."""
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


def _model_structure(root: ET.Element, interface: Interface) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    index = {variable.name: position for position, variable in enumerate(interface.variables, start=1)}
    outputs, derivatives = interface.names("output"), interface.derivatives
    starts = sorted({*outputs, *interface.states, *derivatives}, key=index.__getitem__)
    for section, names, depends in (
        ("Outputs", outputs, interface.direct),
        ("Derivatives", derivatives, interface.direct),
        ("InitialUnknowns", starts, interface.initial),
    ):
        if section == "Derivatives" and not names:
            continue
        parent = ET.SubElement(structure, section)
        for name in names:
            known = sorted(index[other] for other in depends[name])
            ET.SubElement(
                parent,
                "Unknown",
                index=str(index[name]),
                dependencies=" ".join(map(str, known)),
                dependenciesKind=" ".join(["dependent"] * len(known)),
            )
