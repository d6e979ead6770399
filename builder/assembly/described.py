"""Reading of an interface from the modelDescription.xml of an FMU."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from builder.interface import Interface, Variable


def described_interface(root: ET.Element) -> Interface | None:
    """Return the interface of an FMU of eightpost; None for any other FMU."""
    annotation = root.find("VendorAnnotations/Tool[@name='eightpost']/Interface")
    if annotation is None:
        return None
    variables = tuple(_variable(element) for element in root.iterfind("ModelVariables/ScalarVariable"))
    return Interface(
        kind=annotation.get("name", ""),
        version=annotation.get("version", ""),
        description=root.get("description", ""),
        variables=variables,
        direct=_dependencies(root, "Outputs", variables),
        initial=_dependencies(root, "InitialUnknowns", variables),
    )


def _variable(element: ET.Element) -> Variable:
    kind = element[0]
    return Variable(
        name=element.get("name", ""),
        reference=int(element.get("valueReference", "0")),
        type=kind.tag,
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous"),
        unit=kind.get("unit"),
        display=kind.get("displayUnit"),
        start=_start(kind),
        minimum=_number(kind, "min"),
        maximum=_number(kind, "max"),
        description=element.get("description", ""),
    )


def _start(kind: ET.Element) -> float | bool | None:
    text = kind.get("start")
    if text is None:
        return None
    return text in ("true", "1") if kind.tag == "Boolean" else float(text)


def _number(kind: ET.Element, name: str) -> float | None:
    text = kind.get(name)
    return None if text is None else float(text)


def _dependencies(root: ET.Element, section: str, variables: tuple[Variable, ...]) -> Mapping[str, tuple[str, ...]]:
    def name(index: str) -> str:
        return variables[int(index) - 1].name

    return {
        name(unknown.get("index", "")): tuple(name(index) for index in unknown.get("dependencies", "").split())
        for unknown in root.iterfind(f"ModelStructure/{section}/Unknown")
    }
