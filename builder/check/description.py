"""The content of modelDescription.xml exactly as written, in the terms of FMI 2.0, so that errors can be reported.

FMPy's reader stops at the first error; this reader must not.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod

from builder.check.version3 import FLAGS

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")

#: Types of FMI 3.0 and those of FMI 2.0 that the rules know.
OLD_TYPES = {
    **dict.fromkeys(("Float64", "Float32"), "Real"),
    **{f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    **{kind: kind for kind in ("Boolean", "String", "Enumeration", "Binary", "Clock")},
}

#: Member that says what to compile, and how, in FMI 3.0.
BUILD = "sources/buildDescription.xml"

#: Number of values beyond which an array is not looked at.
_MOST_VALUES = 10**6
_MOST_DIGITS = 19

#: Default of `initial` by causality and variability (FMI 2.0.4, tables of 2.2.7).
_DEFAULT_INITIAL = {
    **dict.fromkeys(((c, v) for c in ("parameter", "structuralParameter") for v in ("fixed", "tunable")), "exact"),
    **dict.fromkeys((("output", "constant"), ("local", "constant")), "exact"),
    **dict.fromkeys((("calculatedParameter", v) for v in ("fixed", "tunable")), "calculated"),
    **dict.fromkeys((("output", v) for v in ("discrete", "continuous")), "calculated"),
    **dict.fromkeys((("local", v) for v in ("fixed", "tunable", "discrete", "continuous")), "calculated"),
}
_PARAMETERS = ("parameter", "calculatedParameter", "structuralParameter")

Attributes = Mapping[str, str]


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
    attributes: Attributes
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
    def is_continuous_real(self) -> bool:
        """Whether it can be a state or a derivative."""
        return self.type == "Real" and self.variability == "continuous"

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
    base: Attributes | None
    displays: tuple[Attributes, ...]


@dataclass(frozen=True)
class Description:
    """The content of modelDescription.xml, in the terms of FMI 2.0; `fmi` is the version, 2 or 3.

    Only FMI 3.0 has `aliases` (further names of a variable), `alias_units` (their display units), `dimensions` of
    arrays, and `lengths`, the numbers of their values; all are by the name of the variable.
    """

    fmi: int
    attributes: Attributes
    co_simulation: Attributes | None
    model_exchange: Attributes | None
    source_files: tuple[str, ...]
    exchange_source_files: tuple[str, ...]
    units: tuple[Unit, ...]
    types: Mapping[str, tuple[str, Attributes]]
    categories: tuple[str, ...]
    experiment: Attributes | None
    variables: tuple[Variable, ...]
    sections: frozenset[str]
    unknowns: tuple[Unknown, ...]
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    alias_units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    dimensions: Mapping[str, tuple[Attributes, ...]] = field(default_factory=dict)
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
        for derivative in self.listed_in("Derivatives"):
            if (state := self.variable(derivative.attributes.get("derivative", ""))) is not None:
                yield derivative, state

    def in_section(self, section: str) -> tuple[Unknown, ...]:
        """Return the entries of Outputs, Derivatives or InitialUnknowns."""
        return tuple(unknown for unknown in self.unknowns if unknown.section == section)

    def listed_in(self, section: str) -> list[Variable]:
        """Return the existing variables of a section."""
        return self.named(unknown.index for unknown in self.in_section(section))

    def named(self, indices: Iterable[str]) -> list[Variable]:
        """Return the existing variables with indices as written in ModelStructure."""
        return [variable for variable in map(self.variable, indices) if variable is not None]

    def variable(self, index: str) -> Variable | None:
        """Return the variable with an index as written in ModelStructure."""
        number = whole_number(index)
        return None if number is None else self._by_index.get(number)

    def name_of(self, unknown: Unknown) -> str:
        """Return the name of the variable of an entry, or else its index."""
        variable = self.variable(unknown.index)
        return variable.name if variable else unknown.index

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


# ---- Reading --------------------------------------------------------------------------------------------------------

#: Elements of the sections of ModelStructure.
_SECTIONS_2 = {name: f"{name}/Unknown" for name in ("Outputs", "Derivatives", "InitialUnknowns")}
_SECTIONS_3 = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
    "ClockedStates": "ClockedState",
    "EventIndicators": "EventIndicator",
}
_Types = Mapping[str, tuple[str, Attributes]]


def is_version_3(root: ET.Element) -> bool:
    """Return whether a model description is of FMI 3.0."""
    return root.get("fmiVersion", "").startswith("3.")


def read_description(root: ET.Element, build: ET.Element | None = None) -> Description:
    """Return the content of modelDescription.xml of FMI 2.0 or 3.0 without any checks.

    Args:
        root: Root element of modelDescription.xml.
        build: Root element of sources/buildDescription.xml of FMI 3.0; None if the file is missing.
    """
    is_3, types = is_version_3(root), dict(_types(root))
    sections, index = (_SECTIONS_3, "valueReference") if is_3 else (_SECTIONS_2, "index")
    unknowns = [
        _unknown(name, e, index) for name, tag in sections.items() for e in root.iterfind(f"ModelStructure/{tag}")
    ]
    found = list(root.iterfind("ModelVariables/*" if is_3 else "ModelVariables/ScalarVariable"))
    read = _variable_3 if is_3 else _variable_2
    variables = [read(number, e, types) for number, e in enumerate(found, 1) if not is_3 or e.tag in OLD_TYPES]
    co_simulation, model_exchange = (_interface(root.find(kind), is_3) for kind in ("CoSimulation", "ModelExchange"))
    sources = [_sources(root, kind, build) for kind in ("CoSimulation", "ModelExchange")]
    present = {unknown.section for unknown in unknowns}
    if not is_3:
        present = {name for name in sections if root.find(f"ModelStructure/{name}") is not None}
    description = Description(
        fmi=3 if is_3 else 2,
        attributes=dict(root.attrib),
        co_simulation=co_simulation,
        model_exchange=model_exchange,
        source_files=sources[0],
        exchange_source_files=sources[1],
        units=tuple(_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        categories=tuple(e.get("name", "") for e in root.iterfind("LogCategories/Category")),
        experiment=_attributes(root.find("DefaultExperiment")),
        variables=tuple(variables),
        sections=frozenset(present),
        unknowns=tuple(unknowns),
    )
    return _with_arrays_and_aliases(description, {e.get("name", ""): e for e in found}) if is_3 else description


def _with_arrays_and_aliases(fmu: Description, elements: Mapping[str, ET.Element]) -> Description:
    sizes = {v.reference: v.start or "" for v in fmu.variables if v.causality == "structuralParameter"}
    arrays = {name: tuple(dict(d.attrib) for d in e.iterfind("Dimension")) for name, e in elements.items()}
    lengths = {name: _length(dimensions, sizes) for name, dimensions in arrays.items() if dimensions}
    counts = {v.reference: lengths.get(v.name, 1) for v in fmu.variables}
    indicators = sum(counts.get(unknown.index, 1) for unknown in fmu.in_section("EventIndicators"))
    of_2 = {"guid": fmu.attributes.get("instantiationToken", ""), "numberOfEventIndicators": str(indicators)}
    aliases = {name: list(e.iterfind("Alias")) for name, e in elements.items()}
    units = {n: tuple(a.attrib["displayUnit"] for a in own if "displayUnit" in a.attrib) for n, own in aliases.items()}
    return replace(
        fmu,
        attributes={**fmu.attributes, **of_2},
        aliases={name: tuple(alias.get("name", "") for alias in own) for name, own in aliases.items()},
        alias_units={name: own for name, own in units.items() if own},
        dimensions={name: dimensions for name, dimensions in arrays.items() if dimensions},
        lengths=lengths,
    )


def _length(dimensions: tuple[Attributes, ...], sizes: Attributes) -> int:
    """Return the number of values, with structural parameters at their start values; 0 if it is not known or huge."""
    texts = [d.get("start") or sizes.get(d.get("valueReference", ""), "") for d in dimensions]
    length = prod(whole_number(text.strip()) or 0 for text in texts)
    return length if length <= _MOST_VALUES else 0


def _interface(element: ET.Element | None, is_3: bool) -> Attributes | None:
    """Return the attributes of an interface type, with those of FMI 3.0 also under their names in FMI 2.0."""
    stated = _attributes(element)
    if stated is None or not is_3:
        return stated
    return stated | {FLAGS[name]: value for name, value in stated.items() if name in FLAGS}


def _sources(root: ET.Element, kind: str, build: ET.Element | None) -> tuple[str, ...]:
    files, interface = list(root.iterfind(f"{kind}/SourceFiles/File")), root.find(kind)
    if is_version_3(root):
        name = None if interface is None else interface.get("modelIdentifier")
        parts = [] if build is None or interface is None else build.findall("BuildConfiguration")
        files = [f for e in parts if e.get("modelIdentifier") == name for f in e.iterfind("SourceFileSet/SourceFile")]
    return tuple(file.get("name", "") for file in files)


def _types(root: ET.Element) -> Iterator[tuple[str, tuple[str, Attributes]]]:
    for element in root.iterfind("TypeDefinitions/*"):
        child = element if is_version_3(root) else _typed(element)
        if child is not None and (child is element or element.tag == "SimpleType"):
            yield element.get("name", ""), (child.tag.removesuffix("Type"), dict(child.attrib))


def _typed(element: ET.Element) -> ET.Element | None:
    return next((child for child in element if child.tag in TYPES), None)


def _unit(element: ET.Element) -> Unit:
    displays = tuple(dict(display.attrib) for display in element.iterfind("DisplayUnit"))
    return Unit(element.get("name", ""), _attributes(element.find("BaseUnit")), displays)


def _variable_2(number: int, element: ET.Element, types: _Types) -> Variable:
    child = _typed(element)
    kind, attributes = ("", {}) if child is None else (child.tag, dict(child.attrib))
    return _variable(element, number, kind, "continuous", attributes, types)


def _variable_3(_number: int, element: ET.Element, types: _Types) -> Variable:
    number, attributes = whole_number(element.get("valueReference", "")), dict(element.attrib)
    if (start := element.find("Start")) is not None:
        attributes["start"] = start.get("value", "")
    usual = "continuous" if element.tag in ("Float32", "Float64") else "discrete"
    usual = "fixed" if element.get("causality") in _PARAMETERS else usual
    plain = _variable(element, -1 if number is None else number, OLD_TYPES[element.tag], usual, attributes, types)
    return replace(plain, native=element.tag, is_array=element.find("Dimension") is not None)


def _variable(
    element: ET.Element, index: int, kind: str, usual: str, attributes: Attributes, types: _Types
) -> Variable:
    _, inherited = types.get(attributes.get("declaredType", ""), ("", {}))
    inherited = {name: value for name, value in inherited.items() if name not in ("name", "description")}
    return Variable(
        index=index,
        name=element.get("name", ""),
        reference=element.get("valueReference", ""),
        type=kind,
        causality=element.get("causality", "local"),
        variability=element.get("variability", usual),
        initial=element.get("initial"),
        description=element.get("description", ""),
        attributes={**inherited, **attributes},
    )


def _unknown(section: str, element: ET.Element, index: str) -> Unknown:
    dependencies, kinds = (element.get(name) for name in ("dependencies", "dependenciesKind"))
    words = (None if text is None else tuple(text.split()) for text in (dependencies, kinds))
    return Unknown(section, element.get(index, ""), *words)


def _attributes(element: ET.Element | None) -> dict[str, str] | None:
    return None if element is None else dict(element.attrib)


def whole_number(text: str) -> int | None:
    """Return a text of at most 19 digits as a number; None for any other text."""
    return int(text) if len(text) <= _MOST_DIGITS and text.isascii() and text.isdigit() else None
