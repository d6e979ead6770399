"""The content of modelDescription.xml exactly as written, so that errors in it can be reported.

FMPy's reader stops at the first error; this reader must not.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")
SECTIONS = ("Outputs", "Derivatives", "InitialUnknowns")

#: Default of `initial` by causality and variability (FMI 2.0.4, tables of 2.2.7).
_DEFAULT_INITIAL = {
    **dict.fromkeys((("parameter", v) for v in ("fixed", "tunable")), "exact"),
    **dict.fromkeys((("output", "constant"), ("local", "constant")), "exact"),
    **dict.fromkeys((("calculatedParameter", v) for v in ("fixed", "tunable")), "calculated"),
    **dict.fromkeys((("output", v) for v in ("discrete", "continuous")), "calculated"),
    **dict.fromkeys((("local", v) for v in ("fixed", "tunable", "discrete", "continuous")), "calculated"),
}


@dataclass(frozen=True)
class Variable:
    """One ScalarVariable, with `initial` as written; `attributes` includes those inherited from the declared type."""

    index: int
    name: str
    reference: str
    type: str
    causality: str
    variability: str
    initial: str | None
    description: str
    attributes: Mapping[str, str]

    @property
    def effective_initial(self) -> str | None:
        """Value of `initial`, or its default in the standard if it is not written."""
        return self.initial or _DEFAULT_INITIAL.get((self.causality, self.variability))

    @property
    def start(self) -> str | None:
        """Start value as written."""
        return self.attributes.get("start")

    @property
    def unit(self) -> str | None:
        """Name of the unit."""
        return self.attributes.get("unit")

    @property
    def is_callable(self) -> bool:
        """Whether it has a type and a valid value reference, so that it can be set and read."""
        reference = self.reference
        return self.type in TYPES and reference.isascii() and reference.isdigit() and int(reference) < 2**32

    @property
    def is_settable_at_start(self) -> bool:
        """Whether a host may set it in initialization mode."""
        return self.is_callable and (
            self.causality == "input" or (self.effective_initial == "exact" and self.variability != "constant")
        )

    def number(self, attribute: str) -> float | None:
        """Return an attribute (start, min, max, nominal) as a finite number, or None if it is not one."""
        try:
            value = float(self.attributes[attribute])
        except (KeyError, ValueError):
            return None
        return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Unknown:
    """One entry of ModelStructure, as written; `dependencies` is None if they are not declared."""

    section: str
    index: str
    dependencies: tuple[str, ...] | None
    kinds: tuple[str, ...] | None


@dataclass(frozen=True)
class Unit:
    """One unit: the attributes of its BaseUnit (None if it has no BaseUnit) and of its display units."""

    name: str
    base: Mapping[str, str] | None
    displays: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Description:
    """The content of modelDescription.xml."""

    attributes: Mapping[str, str]
    co_simulation: Mapping[str, str] | None
    model_exchange: Mapping[str, str] | None
    source_files: tuple[str, ...]
    units: tuple[Unit, ...]
    types: Mapping[str, tuple[str, Mapping[str, str]]]
    categories: tuple[str, ...]
    experiment: Mapping[str, str] | None
    variables: tuple[Variable, ...]
    sections: frozenset[str]
    unknowns: tuple[Unknown, ...]
    declared_types: Mapping[str, str] = field(default_factory=dict)

    @property
    def identifier(self) -> str:
        """Attribute modelIdentifier of CoSimulation; of ModelExchange for an FMU that offers only that."""
        return (self.co_simulation or self.model_exchange or {}).get("modelIdentifier", "")

    @property
    def guid(self) -> str:
        """GUID as written."""
        return self.attributes.get("guid", "")

    @property
    def output_derivative_order(self) -> int:
        """Value of maxOutputDerivativeOrder; 0 if it is not a number."""
        text = (self.co_simulation or {}).get("maxOutputDerivativeOrder", "0").strip()
        return int(text) if text.isascii() and text.isdigit() else 0

    def can(self, flag: str) -> bool:
        """Return whether a capability flag of CoSimulation is true."""
        return (self.co_simulation or {}).get(flag, "false").strip() in ("true", "1")

    def can_exchange(self, flag: str) -> bool:
        """Return whether a capability flag of ModelExchange is true."""
        return (self.model_exchange or {}).get(flag, "false").strip() in ("true", "1")

    def state_pairs(self) -> Iterator[tuple[Variable, Variable]]:
        """Yield each derivative that Derivatives lists, with its state."""
        for unknown in self.in_section("Derivatives"):
            derivative = self.variable(unknown.index)
            state = None if derivative is None else self.variable(derivative.attributes.get("derivative", ""))
            if derivative is not None and state is not None:
                yield derivative, state

    def in_section(self, section: str) -> tuple[Unknown, ...]:
        """Return the entries of Outputs, Derivatives or InitialUnknowns."""
        return tuple(unknown for unknown in self.unknowns if unknown.section == section)

    def variable(self, index: str) -> Variable | None:
        """Return the variable with an index as written in ModelStructure."""
        position = int(index) if index.isascii() and index.isdigit() else 0
        return self.variables[position - 1] if 1 <= position <= len(self.variables) else None

    @cached_property
    def by_name(self) -> Mapping[str, Variable]:
        """Variables by name."""
        return {variable.name: variable for variable in self.variables}

    def of(self, causality: str, kind: str = "Real") -> list[Variable]:
        """Return the variables of a causality and type that can be set and read."""
        return [v for v in self.variables if v.causality == causality and v.type == kind and v.is_callable]


def read_description(root: ET.Element) -> Description:
    """Return the content of the root element, without any checks."""
    types = dict(_types(root))
    return Description(
        attributes=dict(root.attrib),
        co_simulation=_attributes(root.find("CoSimulation")),
        model_exchange=_attributes(root.find("ModelExchange")),
        source_files=tuple(f.get("name", "") for f in root.iterfind("CoSimulation/SourceFiles/File")),
        units=tuple(_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        categories=tuple(e.get("name", "") for e in root.iterfind("LogCategories/Category")),
        experiment=_attributes(root.find("DefaultExperiment")),
        variables=tuple(
            _variable(index, e, types) for index, e in enumerate(root.iterfind("ModelVariables/ScalarVariable"), 1)
        ),
        sections=frozenset(s for s in SECTIONS if root.find(f"ModelStructure/{s}") is not None),
        unknowns=tuple(_unknown(s, e) for s in SECTIONS for e in root.iterfind(f"ModelStructure/{s}/Unknown")),
        declared_types=dict(_declared(root)),
    )


def _attributes(element: ET.Element | None) -> dict[str, str] | None:
    return None if element is None else dict(element.attrib)


def _types(root: ET.Element) -> Iterator[tuple[str, tuple[str, Mapping[str, str]]]]:
    for element in root.iterfind("TypeDefinitions/SimpleType"):
        child = _typed(element)
        if child is not None:
            yield element.get("name", ""), (child.tag, dict(child.attrib))


def _typed(element: ET.Element) -> ET.Element | None:
    return next((child for child in element if child.tag in TYPES), None)


def _declared(root: ET.Element) -> Iterator[tuple[str, str]]:
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        child = _typed(element)
        if child is not None and "declaredType" in child.attrib:
            yield element.get("name", ""), child.attrib["declaredType"]


def _unit(element: ET.Element) -> Unit:
    base = element.find("BaseUnit")
    displays = tuple(dict(display.attrib) for display in element.iterfind("DisplayUnit"))
    return Unit(element.get("name", ""), None if base is None else dict(base.attrib), displays)


def _variable(index: int, element: ET.Element, types: Mapping[str, tuple[str, Mapping[str, str]]]) -> Variable:
    child = _typed(element)
    attributes = {} if child is None else dict(child.attrib)
    _, inherited = types.get(attributes.get("declaredType", ""), ("", {}))
    return Variable(
        index=index,
        name=element.get("name", ""),
        reference=element.get("valueReference", ""),
        type="" if child is None else child.tag,
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous"),
        initial=element.get("initial"),
        description=element.get("description", ""),
        attributes={**inherited, **attributes},
    )


def _unknown(section: str, element: ET.Element) -> Unknown:
    return Unknown(
        section, element.get("index", ""), _words(element.get("dependencies")), _words(element.get("dependenciesKind"))
    )


def _words(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(text.split())
