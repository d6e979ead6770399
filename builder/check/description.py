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
_MOST_DIGITS = 19

#: Default of `initial` by causality and variability (FMI 2.0.4, tables of 2.2.7).
_DEFAULT_INITIAL = {
    **dict.fromkeys(((c, v) for c in ("parameter", "structuralParameter") for v in ("fixed", "tunable")), "exact"),
    **dict.fromkeys((("output", "constant"), ("local", "constant")), "exact"),
    **dict.fromkeys((("calculatedParameter", v) for v in ("fixed", "tunable")), "calculated"),
    **dict.fromkeys((("output", v) for v in ("discrete", "continuous")), "calculated"),
    **dict.fromkeys((("local", v) for v in ("fixed", "tunable", "discrete", "continuous")), "calculated"),
}


@dataclass(frozen=True)
class Variable:
    """One variable, with `initial` as written; `attributes` includes those inherited from the declared type.

    ModelStructure names a variable by `index`: its position in FMI 2.0, its value reference in FMI 3.0. `native` is the
    type of FMI 3.0, such as Float64, or an empty string in FMI 2.0.
    """

    index: int
    name: str
    reference: str
    type: str
    causality: str
    variability: str
    initial: str | None
    description: str
    attributes: Mapping[str, str]
    native: str = ""
    is_array: bool = False

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
        reference = whole_number(self.reference)
        return self.type in TYPES and reference is not None and reference < 2**32 and not self.is_array

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
    """The content of modelDescription.xml, in the terms of FMI 2.0; `fmi` is the version, 2 or 3.

    Only FMI 3.0 has `aliases` (further names of a variable), `alias_units` (their display units), `dimensions` of
    arrays, and `lengths`, the numbers of their values; all are by the name of the variable.
    """

    attributes: Mapping[str, str]
    co_simulation: Mapping[str, str] | None
    model_exchange: Mapping[str, str] | None
    source_files: tuple[str, ...]
    exchange_source_files: tuple[str, ...]
    units: tuple[Unit, ...]
    types: Mapping[str, tuple[str, Mapping[str, str]]]
    categories: tuple[str, ...]
    experiment: Mapping[str, str] | None
    variables: tuple[Variable, ...]
    sections: frozenset[str]
    unknowns: tuple[Unknown, ...]
    fmi: int = 2
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    alias_units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    dimensions: Mapping[str, tuple[Mapping[str, str], ...]] = field(default_factory=dict)
    lengths: Mapping[str, int] = field(default_factory=dict)

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
        return whole_number((self.co_simulation or {}).get("maxOutputDerivativeOrder", "0").strip()) or 0

    @property
    def interpolated_inputs(self) -> list[Variable]:
        """Inputs that may change linearly during a step: by input derivatives, or by intermediate updates."""
        if not self.can("canInterpolateInputs"):
            return []
        inputs = [v for v in self.of("input") if v.variability == "continuous"]
        if self.fmi == 2:
            return inputs
        return [v for v in inputs if v.native == "Float64" and v.attributes.get("intermediateUpdate") in ("true", "1")]

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
        number = whole_number(index)
        return None if number is None else self._by_index.get(number)

    @cached_property
    def _by_index(self) -> Mapping[int, Variable]:
        return {variable.index: variable for variable in reversed(self.variables)}

    @cached_property
    def by_name(self) -> Mapping[str, Variable]:
        """Variables by name."""
        return {variable.name: variable for variable in self.variables}

    def of(self, causality: str, kind: str = "Real") -> list[Variable]:
        """Return the variables of a causality and type that can be set and read."""
        return [v for v in self.variables if v.causality == causality and v.type == kind and v.is_callable]


def read_description_2(root: ET.Element) -> Description:
    """Return the content of the root element of FMI 2.0, without any checks."""
    types = dict(_types(root))
    return Description(
        attributes=dict(root.attrib),
        co_simulation=attributes_of(root.find("CoSimulation")),
        model_exchange=attributes_of(root.find("ModelExchange")),
        source_files=_source_files(root, "CoSimulation"),
        exchange_source_files=_source_files(root, "ModelExchange"),
        units=tuple(unit_of(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        categories=tuple(e.get("name", "") for e in root.iterfind("LogCategories/Category")),
        experiment=attributes_of(root.find("DefaultExperiment")),
        variables=tuple(
            _variable(index, e, types) for index, e in enumerate(root.iterfind("ModelVariables/ScalarVariable"), 1)
        ),
        sections=frozenset(s for s in SECTIONS if root.find(f"ModelStructure/{s}") is not None),
        unknowns=tuple(_unknown(s, e) for s in SECTIONS for e in root.iterfind(f"ModelStructure/{s}/Unknown")),
    )


def _source_files(root: ET.Element, kind: str) -> tuple[str, ...]:
    return tuple(file.get("name", "") for file in root.iterfind(f"{kind}/SourceFiles/File"))


def attributes_of(element: ET.Element | None) -> dict[str, str] | None:
    """Return the attributes of an element; None if there is no element."""
    return None if element is None else dict(element.attrib)


def _types(root: ET.Element) -> Iterator[tuple[str, tuple[str, Mapping[str, str]]]]:
    for element in root.iterfind("TypeDefinitions/SimpleType"):
        child = _typed(element)
        if child is not None:
            yield element.get("name", ""), (child.tag, dict(child.attrib))


def _typed(element: ET.Element) -> ET.Element | None:
    return next((child for child in element if child.tag in TYPES), None)


def unit_of(element: ET.Element) -> Unit:
    """Return a unit as written."""
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
        section,
        element.get("index", ""),
        words_of(element.get("dependencies")),
        words_of(element.get("dependenciesKind")),
    )


def whole_number(text: str) -> int | None:
    """Return a text of at most 19 digits as a number; None for any other text."""
    return int(text) if len(text) <= _MOST_DIGITS and text.isascii() and text.isdigit() else None


def words_of(text: str | None) -> tuple[str, ...] | None:
    """Return the words of a list; None if there is no list."""
    return None if text is None else tuple(text.split())
