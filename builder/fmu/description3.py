"""Generation of modelDescription.xml of FMI 3.0 (FMI 3.0.2, Co-Simulation and Model Exchange)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from builder.fmu.description import Description, add_environment, root_element, type_attributes
from builder.fmu.interface import Interface, Variable

#: The independent variable; its value reference is that in fmus/fmi3/fmi3_instance.h.
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
    "canGetAndSetFMUState": "canGetAndSetFMUstate",
    "canSerializeFMUState": "canSerializeFMUstate",
    "providesDirectionalDerivatives": "providesDirectionalDerivative",
    "providesAdjointDerivatives": "providesDirectionalDerivative",
}
_SAME = ("needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess", "canHandleVariableCommunicationStepSize")

_TYPES = {"Real": "Float64", "Boolean": "Boolean"}


def model_description_3(description: Description) -> bytes:
    """Return modelDescription.xml of FMI 3.0; the same description gives the same bytes.

    The variables and their value references are those of FMI 2.0; the independent variable `time` is added.
    """
    interface = description.interface
    variables = (_TIME, *interface.variables)
    root = root_element("3.0", "instantiationToken", description)
    if description.exchange is not None:
        ET.SubElement(root, "ModelExchange", _exchange(description.identifier, description.exchange))
    ET.SubElement(root, "CoSimulation", _co_simulation(description.identifier, description.capabilities))
    add_environment(root, description, variables)
    _model_variables(root, variables)
    _model_structure(root, interface)
    annotation = ET.SubElement(ET.SubElement(root, "Annotations"), "Annotation", type="eightpost")
    ET.SubElement(annotation, "Interface", name=interface.kind, version=interface.version)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _capabilities(identifier: str, flags: Mapping[str, str]) -> dict[str, str]:
    renamed = {name: flags[old] for name, old in _RENAMED.items() if old in flags}
    return {"modelIdentifier": identifier} | {name: flags[name] for name in _SAME if name in flags} | renamed


def _exchange(identifier: str, flags: Mapping[str, str]) -> dict[str, str]:
    needed = {"true": "false", "false": "true"}[flags["completedIntegratorStepNotNeeded"]]
    return _capabilities(identifier, flags) | {"needsCompletedIntegratorStep": needed}


def _co_simulation(identifier: str, flags: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes; inputs that FMI 2.0 interpolates with derivatives come from intermediate updates."""
    return _capabilities(identifier, flags) | {
        "providesIntermediateUpdate": flags["canInterpolateInputs"],
        "recommendedIntermediateInputSmoothness": "0",  # the inputs are piecewise linear: continuous, with kinks
        "hasEventMode": "false",
    }


def _model_variables(root: ET.Element, variables: Sequence[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    references = {variable.name: str(variable.reference) for variable in variables}
    for variable in variables:
        attributes = {
            "name": variable.name,
            "valueReference": references[variable.name],
            "description": variable.description,
            "causality": variable.causality,
            "variability": variable.variability,
        }
        if variable.initial:
            attributes["initial"] = variable.initial
        if variable.causality == "input":
            attributes["intermediateUpdate"] = "true"
        if variable.derivative_of is not None:
            attributes["derivative"] = references[variable.derivative_of]
        ET.SubElement(parent, _TYPES[variable.type], attributes | type_attributes(variable))


def _model_structure(root: ET.Element, interface: Interface) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    reference = {variable.name: variable.reference for variable in interface.variables}
    outputs, derivatives = interface.names("output"), interface.derivatives
    starts = sorted({*outputs, *interface.states, *derivatives}, key=list(reference).index)
    for element, names, depends in (
        ("Output", outputs, interface.direct),
        ("ContinuousStateDerivative", derivatives, interface.direct),
        ("InitialUnknown", starts, interface.initial),
    ):
        for name in names:
            known = sorted(reference[other] for other in depends[name])
            attributes = {
                "valueReference": str(reference[name]),
                "dependencies": " ".join(map(str, known)),
                "dependenciesKind": " ".join(["dependent"] * len(known)),
            }
            ET.SubElement(structure, element, attributes)
