"""FMI 2.0 and 3.0: functions, which fmi_functions.txt lists, and the content of modelDescription.xml as written.

The description is in the terms of FMI 2.0. Errors in it can be reported; FMPy's reader stops at the first one.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from ctypes import c_bool, c_char_p, c_double, c_int, c_size_t, c_void_p
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any

_ARGUMENTS = {"p": c_void_p, "n": c_size_t, "d": c_double, "i": c_int, "b": c_bool}
_RESULTS = {"Instantiate": c_void_p, "FreeInstance": None, "GetVersion": c_char_p, "GetTypesPlatform": c_char_p}
_KINDS = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_RESULTS |= {f"Instantiate{kind}": c_void_p for kind in _KINDS}


@dataclass(frozen=True)
class Function:
    """One function; see fmi_functions.txt."""

    needed_by: tuple[str, ...]  #: all, cs, me, optional, other.
    arguments: tuple[Any, ...]  #: Types of its arguments; not stated for functions that nothing calls.
    result: Any  #: Type of its result.


def _lines() -> Iterator[tuple[int, str, Function]]:
    for line in Path(__file__).with_name("fmi_functions.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            version, needed_by, arguments, names = (part.strip() for part in line.split("|"))
            types = tuple(_ARGUMENTS[letter] for letter in arguments if letter != "?")
            for name in names.split():
                yield int(version), name, Function(tuple(needed_by.split()), types, _RESULTS.get(name, c_int))


#: Functions by version of FMI (2 or 3) and name without prefix.
FUNCTIONS: dict[int, dict[str, Function]] = {2: {}, 3: {}}
for _version, _name, _function in _lines():
    FUNCTIONS[_version][_name] = _function


def names(version: int, *needed_by: str) -> frozenset[str]:
    """Return the names in C of the functions that some need: all, cs, me, optional, other; of all without any."""
    functions = FUNCTIONS[version].items()
    return frozenset(f"fmi{version}{n}" for n, f in functions if not needed_by or set(needed_by) & set(f.needed_by))


# ---- Statuses, and names that differ between the versions -----------------------------------------------------------

#: fmi2Status, fmi3Status; pending in FMI 2.0 only.
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)

#: Functions with another name in FMI 3.0, both without fmi2 or fmi3. Values have one function for each type.
RENAMED = {
    "SetReal": "SetFloat64",
    "GetReal": "GetFloat64",
    "SetInteger": "SetInt32",
    "GetInteger": "GetInt32",
    "Instantiate": "InstantiateCoSimulation",
    "SetupExperiment": "EnterInitializationMode",
    "GetFMUstate": "GetFMUState",
    "SetFMUstate": "SetFMUState",
    "FreeFMUstate": "FreeFMUState",
    "SerializedFMUstateSize": "SerializedFMUStateSize",
    "SerializeFMUstate": "SerializeFMUState",
    "DeSerializeFMUstate": "DeserializeFMUState",
    "NewDiscreteStates": "UpdateDiscreteStates",
    "GetDerivatives": "GetContinuousStateDerivatives",
    "GetRealOutputDerivatives": "GetOutputDerivatives",
    "SetRealInputDerivatives": "IntermediateUpdateCallback",
    "GetBooleanStatus": "DoStep",
}

#: Attributes of CoSimulation and ModelExchange in FMI 2.0, by their names in FMI 3.0.
FLAGS = {
    "canGetAndSetFMUState": "canGetAndSetFMUstate",
    "canSerializeFMUState": "canSerializeFMUstate",
    "providesDirectionalDerivatives": "providesDirectionalDerivative",
    "providesIntermediateUpdate": "canInterpolateInputs",
}


def function_name(name: str) -> str:
    """Return the name in FMI 3.0 of a function of FMI 2.0, both without fmi2 or fmi3."""
    return RENAMED.get(name, name)


# ==== modelDescription.xml ===========================================================================================


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
    """One variable, with everything as written."""

    index: int  #: Number that ModelStructure uses: the position in FMI 2.0, the value reference in FMI 3.0.
    name: str  #: Name of the variable.
    reference: str  #: Value reference.
    type: str  #: Type of FMI 2.0, which is the same for Float32 and Float64; empty if it is not written.
    causality: str  #: input, output, parameter ...; local if it is not written.
    variability: str  #: continuous, discrete, tunable ...; the default of the standard if it is not written.
    initial: str | None  #: exact, approx or calculated; None if it is not written.
    description: str  #: Text about the variable.
    attributes: Attributes  #: All other attributes, including those inherited from the declared type.
    native: str = ""  #: Type of FMI 3.0, such as Float64; empty in FMI 2.0.
    aliases: tuple[Attributes, ...] = ()  #: Attributes of its further names (FMI 3.0).
    dimensions: tuple[Attributes, ...] = ()  #: Attributes of the dimensions of an array (FMI 3.0).
    starts: tuple[str, ...] = ()  #: Start values of a String or Binary variable of FMI 3.0.

    @property
    def is_array(self) -> bool:
        """Whether it is an array."""
        return bool(self.dimensions)

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
class Sources:
    """What to compile: C files and folders of headers in sources/, and attributes of definitions."""

    files: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()
    definitions: tuple[Attributes, ...] = ()


@dataclass(frozen=True)
class Description:
    """The content of modelDescription.xml, in the terms of FMI 2.0."""

    fmi: int  #: Version of FMI: 2 or 3.
    attributes: Attributes  #: Attributes of the root element.
    #: Attributes of CoSimulation and ModelExchange, those of FMI 3.0 also under their names in FMI 2.0.
    co_simulation: Attributes | None
    model_exchange: Attributes | None
    is_scheduled: bool  #: Whether it offers scheduled execution (FMI 3.0).
    sources: Sources  #: What to compile for co-simulation.
    exchange_sources: Sources  #: What to compile for model exchange.
    units: tuple[Unit, ...]  #: Units.
    types: Mapping[str, tuple[str, Attributes]]  #: Type and attributes of each type definition, by its name.
    items: Mapping[str, Mapping[str, str]]  #: Value of each item of an enumeration, by the names of type and item.
    categories: tuple[str, ...]  #: Log categories.
    experiment: Attributes | None  #: Attributes of the default experiment.
    variables: tuple[Variable, ...]  #: Variables in their order.
    sections: frozenset[str]  #: Sections that ModelStructure has.
    unknowns: tuple[Unknown, ...]  #: Entries of ModelStructure.

    @property
    def identifier(self) -> str:
        """Attribute modelIdentifier of CoSimulation; of ModelExchange for an FMU that offers only that."""
        return (self.co_simulation or self.model_exchange or {}).get("modelIdentifier", "")

    @property
    def guid(self) -> str:
        """GUID, or instantiation token of FMI 3.0, as written."""
        return self.attributes.get("guid" if self.fmi == 2 else "instantiationToken", "")

    @cached_property
    def lengths(self) -> Mapping[str, int]:
        """Number of values of each array, by its name; 0 if it is not known or huge."""
        sizes = {v.reference: v.start or "" for v in self.variables if v.causality == "structuralParameter"}
        return {v.name: _length(v.dimensions, sizes) for v in self.variables if v.is_array}

    @property
    def event_indicators(self) -> str:
        """Number of event indicators, as written in FMI 2.0."""
        if self.fmi == 2:
            return self.attributes.get("numberOfEventIndicators", "0").strip()
        counts = {v.reference: self.lengths.get(v.name, 1) for v in self.variables}
        return str(sum(counts.get(unknown.index, 1) for unknown in self.in_section("EventIndicators")))

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


def _is_version_3(root: ET.Element) -> bool:
    """Return whether a model description is of FMI 3.0."""
    return root.get("fmiVersion", "").startswith("3.")


def read_description(root: ET.Element, build: ET.Element | None = None) -> Description:
    """Return the content of modelDescription.xml of FMI 2.0 or 3.0 without any checks.

    Args:
        root: Root element of modelDescription.xml.
        build: Root element of sources/buildDescription.xml of FMI 3.0; None if the file is missing.
    """
    is_3, types = _is_version_3(root), dict(_types(root))
    sections, index = (_SECTIONS_3, "valueReference") if is_3 else (_SECTIONS_2, "index")
    unknowns = [
        _unknown(name, e, index) for name, tag in sections.items() for e in root.iterfind(f"ModelStructure/{tag}")
    ]
    if is_3:
        variables = [_variable_3(e, types) for e in root.iterfind("ModelVariables/*") if e.tag in OLD_TYPES]
    else:
        found = root.iterfind("ModelVariables/ScalarVariable")
        variables = [_variable_2(number, e, types) for number, e in enumerate(found, 1)]
    kinds = ("CoSimulation", "ModelExchange")
    co_simulation, model_exchange = (_interface(root.find(kind), is_3) for kind in kinds)
    sources, exchange_sources = (_sources(root, kind, build) for kind in kinds)
    present = {unknown.section for unknown in unknowns}
    if not is_3:
        present = {name for name in sections if root.find(f"ModelStructure/{name}") is not None}
    return Description(
        fmi=3 if is_3 else 2,
        attributes=dict(root.attrib),
        co_simulation=co_simulation,
        model_exchange=model_exchange,
        is_scheduled=root.find("ScheduledExecution") is not None,
        sources=sources,
        exchange_sources=exchange_sources,
        units=tuple(_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        items={e.get("name", ""): items for e in root.iterfind("TypeDefinitions/*") if (items := _items(e))},
        categories=_named(root.iterfind("LogCategories/Category")),
        experiment=_attributes(root.find("DefaultExperiment")),
        variables=tuple(variables),
        sections=frozenset(present),
        unknowns=tuple(unknowns),
    )


def _length(dimensions: tuple[Attributes, ...], sizes: Attributes) -> int:
    """Return the number of values, with structural parameters at their start values."""
    texts = [d.get("start") or sizes.get(d.get("valueReference", ""), "") for d in dimensions]
    length = prod(whole_number(text.strip()) or 0 for text in texts)
    return length if length <= _MOST_VALUES else 0


def _interface(element: ET.Element | None, is_3: bool) -> Attributes | None:
    """Return the attributes of an interface type, with those of FMI 3.0 also under their names in FMI 2.0."""
    stated = _attributes(element)
    if stated is None or not is_3:
        return stated
    return stated | {FLAGS[name]: value for name, value in stated.items() if name in FLAGS}


def _sources(root: ET.Element, kind: str, build: ET.Element | None) -> Sources:
    interface = root.find(kind)
    if not _is_version_3(root):
        return Sources(_named(root.iterfind(f"{kind}/SourceFiles/File")))
    if build is None or interface is None:
        return Sources()
    name = interface.get("modelIdentifier")
    parts = [part for part in build.findall("BuildConfiguration") if part.get("modelIdentifier") == name]
    sets = [files for part in parts for files in part.iterfind("SourceFileSet")]
    return Sources(
        _named(e for files in sets for e in files.iterfind("SourceFile")),
        _named(e for files in sets for e in files.iterfind("IncludeDirectory")),
        tuple(dict(e.attrib) for files in sets for e in files.iterfind("PreprocessorDefinition")),
    )


def _named(elements: Iterable[ET.Element]) -> tuple[str, ...]:
    return tuple(element.get("name", "") for element in elements)


def _types(root: ET.Element) -> Iterator[tuple[str, tuple[str, Attributes]]]:
    for element in root.iterfind("TypeDefinitions/*"):
        child = element if _is_version_3(root) else _typed(element)
        if child is not None and (child is element or element.tag == "SimpleType"):
            yield element.get("name", ""), (child.tag.removesuffix("Type"), dict(child.attrib))


def _typed(element: ET.Element) -> ET.Element | None:
    return next((child for child in element if child.tag in TYPES), None)


def _items(element: ET.Element) -> dict[str, str]:
    return {item.get("name", ""): item.get("value", "") for item in element.iter("Item")}


def _unit(element: ET.Element) -> Unit:
    displays = tuple(dict(display.attrib) for display in element.iterfind("DisplayUnit"))
    return Unit(element.get("name", ""), _attributes(element.find("BaseUnit")), displays)


def _variable_2(number: int, element: ET.Element, types: _Types) -> Variable:
    child = _typed(element)
    kind, attributes = ("", {}) if child is None else (child.tag, dict(child.attrib))
    return _variable(element, number, kind, "continuous", attributes, types)


def _variable_3(element: ET.Element, types: _Types) -> Variable:
    number, attributes = whole_number(element.get("valueReference", "")), dict(element.attrib)
    starts = tuple(start.get("value", "") for start in element.iterfind("Start"))
    if starts:
        attributes["start"] = starts[0]
    usual = "continuous" if element.tag in ("Float32", "Float64") else "discrete"
    usual = "fixed" if element.get("causality") in _PARAMETERS else usual
    plain = _variable(element, -1 if number is None else number, OLD_TYPES[element.tag], usual, attributes, types)
    aliases, dimensions = (tuple(dict(e.attrib) for e in element.iterfind(name)) for name in ("Alias", "Dimension"))
    return replace(plain, native=element.tag, aliases=aliases, dimensions=dimensions, starts=starts)


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
