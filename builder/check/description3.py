"""The content of modelDescription.xml of either version; that of FMI 3.0 exactly as written, in terms of FMI 2.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from math import prod

from builder.check.description import (
    Description,
    Unknown,
    Variable,
    attributes_of,
    read_description_2,
    unit_of,
    whole_number,
    words_of,
)
from builder.check.version3 import FLAGS

#: Member that says what to compile, and how.
BUILD = "sources/buildDescription.xml"

#: Types of FMI 3.0 and those of FMI 2.0 that the rules know.
OLD_TYPES = {
    "Float64": "Real",
    "Float32": "Real",
    **{f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
    "Binary": "Binary",
    "Clock": "Clock",
}

_SECTIONS = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
    "ClockedStates": "ClockedState",
    "EventIndicators": "EventIndicator",
}

#: Number of values beyond which an array is not looked at.
_MOST_VALUES = 10**6

_PARAMETERS = ("parameter", "calculatedParameter", "structuralParameter")


def read_description(root: ET.Element, build: ET.Element | None = None) -> Description:
    """Return the content of modelDescription.xml of FMI 2.0 or 3.0 without any checks.

    Args:
        root: Root element of modelDescription.xml.
        build: Root element of sources/buildDescription.xml of FMI 3.0; None if the file is missing.
    """
    return _read_3(root, build) if is_version_3(root) else read_description_2(root)


def is_version_3(root: ET.Element) -> bool:
    """Return whether a model description is of FMI 3.0."""
    return root.get("fmiVersion", "").startswith("3.")


def _read_3(root: ET.Element, build: ET.Element | None) -> Description:
    types = dict(_types(root))
    unknowns = [_unknown(name, e) for name, tag in _SECTIONS.items() for e in root.iterfind(f"ModelStructure/{tag}")]
    parent = root.find("ModelVariables")
    variables = [] if parent is None else [_variable(e, types) for e in parent if e.tag in OLD_TYPES]
    sizes = {v.reference: v.start or "" for v in variables if v.causality == "structuralParameter"}
    elements = {} if parent is None else {e.get("name", ""): e for e in parent}
    lengths = {name: _length(dimensions, sizes) for name, e in elements.items() if (dimensions := _dimensions(e))}
    by_reference = {v.reference: lengths.get(v.name, 1) for v in variables}
    indicators = sum(by_reference.get(u.index, 1) for u in unknowns if u.section == "EventIndicators")
    return Description(
        attributes=dict(root.attrib)
        | {"guid": root.get("instantiationToken", ""), "numberOfEventIndicators": str(indicators)},
        co_simulation=_interface(root.find("CoSimulation")),
        model_exchange=_interface(root.find("ModelExchange")),
        source_files=_source_files(build, root.find("CoSimulation")),
        exchange_source_files=_source_files(build, root.find("ModelExchange")),
        units=tuple(unit_of(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        categories=tuple(e.get("name", "") for e in root.iterfind("LogCategories/Category")),
        experiment=attributes_of(root.find("DefaultExperiment")),
        variables=tuple(variables),
        sections=frozenset(unknown.section for unknown in unknowns),
        unknowns=tuple(unknowns),
        fmi=3,
        alias_units={name: units for name, element in elements.items() if (units := tuple(_alias_units(element)))},
        aliases={name: tuple(_alias_names(element)) for name, element in elements.items()},
        dimensions={name: dimensions for name, e in elements.items() if (dimensions := _dimensions(e))},
        lengths=lengths,
    )


def _interface(element: ET.Element | None) -> dict[str, str] | None:
    """Return the attributes of an interface type, with those that FMI 2.0 knows also under their names there."""
    if element is None:
        return None
    stated = dict(element.attrib)
    return stated | {FLAGS[name]: value for name, value in stated.items() if name in FLAGS}


def _source_files(build: ET.Element | None, interface: ET.Element | None) -> tuple[str, ...]:
    if build is None or interface is None:
        return ()
    own = [
        e for e in build.iterfind("BuildConfiguration") if e.get("modelIdentifier") == interface.get("modelIdentifier")
    ]
    return tuple(file.get("name", "") for e in own for file in e.iterfind("SourceFileSet/SourceFile"))


def _types(root: ET.Element) -> Iterator[tuple[str, tuple[str, Mapping[str, str]]]]:
    for element in root.iterfind("TypeDefinitions/*"):
        yield element.get("name", ""), (element.tag.removesuffix("Type"), dict(element.attrib))


def _variable(element: ET.Element, types: Mapping[str, tuple[str, Mapping[str, str]]]) -> Variable:
    causality, reference = element.get("causality", "local"), element.get("valueReference", "")
    attributes = dict(element.attrib)
    _, inherited = types.get(attributes.get("declaredType", ""), ("", {}))
    if (start := element.find("Start")) is not None:
        attributes["start"] = start.get("value", "")
    continuous = "continuous" if element.tag in ("Float32", "Float64") else "discrete"
    return Variable(
        index=-1 if (number := whole_number(reference)) is None else number,
        name=element.get("name", ""),
        reference=reference,
        type=OLD_TYPES[element.tag],
        causality=causality,
        variability=element.get("variability", "fixed" if causality in _PARAMETERS else continuous),
        initial=element.get("initial"),
        description=element.get("description", ""),
        attributes={**{k: v for k, v in inherited.items() if k not in ("name", "description")}, **attributes},
        native=element.tag,
        is_array=element.find("Dimension") is not None,
    )


def _alias_names(element: ET.Element) -> Iterator[str]:
    for alias in element.iterfind("Alias"):
        yield alias.get("name", "")


def _alias_units(element: ET.Element) -> Iterator[str]:
    for alias in element.iterfind("Alias"):
        if "displayUnit" in alias.attrib:
            yield alias.attrib["displayUnit"]


def _dimensions(element: ET.Element) -> tuple[Mapping[str, str], ...]:
    return tuple(dict(dimension.attrib) for dimension in element.iterfind("Dimension"))


def _length(dimensions: tuple[Mapping[str, str], ...], sizes: Mapping[str, str]) -> int:
    """Return the number of values, with structural parameters at their start values; 0 if it is not known or huge."""
    texts = [d.get("start") or sizes.get(d.get("valueReference", ""), "") for d in dimensions]
    length = prod(whole_number(text.strip()) or 0 for text in texts)
    return length if length <= _MOST_VALUES else 0


def _unknown(section: str, element: ET.Element) -> Unknown:
    return Unknown(
        section,
        element.get("valueReference", ""),
        words_of(element.get("dependencies")),
        words_of(element.get("dependenciesKind")),
    )
