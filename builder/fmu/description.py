"""Generation of modelDescription.xml from an interface (FMI 2.0.4 and 3.0.2, Co-Simulation and Model Exchange)."""

from __future__ import annotations

import hashlib
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from builder.fmu.interface import Interface, Variable
from eightpost import __version__, units
from eightpost.fmi.functions import FLAGS

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


#: The independent variable of FMI 3.0; its value reference is that in fmus/fmi3/fmi3_instance.h.
_TIME = Variable(
    name="time",
    reference=1000000,
    type="Real",
    causality="independent",
    variability="continuous",
    unit="s",
    display=None,
    start=None,
    minimum=None,
    maximum=None,
    description="Simulation time",
)

#: Capabilities of FMI 2.0 by their names in FMI 3.0.
_RENAMED = {
    **{name: name for name in ("needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess")},
    "canHandleVariableCommunicationStepSize": "canHandleVariableCommunicationStepSize",
    **{name: old for name, old in FLAGS.items() if name != "providesIntermediateUpdate"},
    "providesAdjointDerivatives": "providesDirectionalDerivative",
}
_TYPES = {"Real": "Float64", "Boolean": "Boolean"}


def model_description(description: Description, fmi: int = 2) -> bytes:
    """Return modelDescription.xml of FMI 2.0 or 3.0; the same description gives the same bytes.

    The variables and their value references are the same in both versions; FMI 3.0 adds the variable `time`.
    """
    interface, is_3 = description.interface, fmi == 3
    variables = (_TIME, *interface.variables) if is_3 else interface.variables
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "3.0" if is_3 else "2.0",
            "modelName": description.identifier,
            "instantiationToken" if is_3 else "guid": f"{{{description.guid}}}",
        },
        description=description.text,
        author="eightpost",
        version=__version__,
        license="MIT",
        generationTool=description.generation_tool,
        variableNamingConvention="structured",
        **({} if is_3 else {"numberOfEventIndicators": "0"}),
    )
    for kind, flags in (("ModelExchange", description.exchange), ("CoSimulation", description.capabilities)):
        if flags is not None:
            own = _flags_3(kind, flags) if is_3 else flags
            element = ET.SubElement(root, kind, {"modelIdentifier": description.identifier, **own})
            if description.source_files and not is_3:  # FMI 3.0 lists them in buildDescription.xml
                files = ET.SubElement(element, "SourceFiles")
                for file in description.source_files:
                    ET.SubElement(files, "File", name=file)
    _unit_definitions(root, variables)
    categories = ET.SubElement(root, "LogCategories")
    for name, text in _LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=text)
    times = {"startTime": 0.0, "stopTime": description.stop_time, "stepSize": description.step_size}
    ET.SubElement(root, "DefaultExperiment", {name: repr(value) for name, value in times.items()})
    note = ET.Element("Interface", name=interface.kind, version=interface.version)
    if is_3:
        _variables_3(root, variables)
        _structure(root, interface, {v.name: v.reference for v in interface.variables}, is_3)
        ET.SubElement(ET.SubElement(root, "Annotations"), "Annotation", type="eightpost").append(note)
    else:
        ET.SubElement(ET.SubElement(root, "VendorAnnotations"), "Tool", name="eightpost").append(note)
        index = {v.name: position for position, v in enumerate(variables, start=1)}
        _variables_2(root, variables, index)
        _structure(root, interface, index, is_3)
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


def _variables_2(root: ET.Element, variables: Iterable[Variable], index: Mapping[str, int]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    for variable in variables:
        of = {} if variable.derivative_of is None else {"derivative": str(index[variable.derivative_of])}
        attributes = _named(variable) | ({"initial": variable.initial} if variable.initial else {})
        ET.SubElement(ET.SubElement(parent, "ScalarVariable", attributes), variable.type, _typed(variable) | of)


def _variables_3(root: ET.Element, variables: Iterable[Variable]) -> None:
    parent, references = ET.SubElement(root, "ModelVariables"), {v.name: str(v.reference) for v in variables}
    for variable in variables:
        attributes = _named(variable) | ({"initial": variable.initial} if variable.initial else {})
        attributes |= {"intermediateUpdate": "true"} if variable.causality == "input" else {}
        of = {} if variable.derivative_of is None else {"derivative": references[variable.derivative_of]}
        ET.SubElement(parent, _TYPES[variable.type], attributes | of | _typed(variable))


def _named(variable: Variable) -> dict[str, str]:
    return {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }


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
    """Add the unknowns; `number` identifies variables: by position in FMI 2.0, by value reference in FMI 3.0."""
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
