"""SystemStructureDescription files: elements and parameter bindings."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from pathlib import Path

from cosim.components.component import Conversion, UnitDefinition
from cosim.ssp import package
from cosim.ssp.package import (
    Assignment,
    Connector,
    Experiment,
    FmuElement,
    Link,
    Place,
    Structure,
    SystemElement,
    Value,
    attribute,
    flag,
    integer,
    local_name,
    named,
    number,
    open_package,
    read_inside,
    tag,
)
from eightpost.errors import InputError, WiringError

# ---- Parameter sets (.ssv or inline) and mappings (.ssm or inline) as assignments -----------------------------------

_SET, _MAPPING = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class _Definitions:
    """Units and enumerations that a file defines."""

    units: Mapping[str, UnitDefinition]
    enumerations: Mapping[str, Mapping[str, int]]

    @classmethod
    def read(cls, root: ET.Element, prefix: str, where: str) -> _Definitions:
        """Read the definitions from a file's root element."""
        return cls(
            package.read_units(root, f"{prefix}:Units", where),
            package.read_enumerations(root, f"{prefix}:Enumerations", where),
        )

    def with_those_of(self, other: _Definitions) -> _Definitions:
        """Return the definitions of both; the other's take precedence."""
        return _Definitions({**self.units, **other.units}, {**self.enumerations, **other.enumerations})


@dataclass(frozen=True)
class _Bindings:
    """Reader of the parameter bindings of an element."""

    place: Place  #: Description that contains the bindings.
    definitions: _Definitions  #: Units and enumerations of the description, for inline values that name them.
    component: Path | None  #: Archive of the component, for sources that are inside it.

    def read(self, element: ET.Element, what: str) -> tuple[Assignment, ...]:
        """Return the values of an element's bindings, in order."""
        bindings = element.iterfind(f"{tag('ssd:ParameterBindings')}/{tag('ssd:ParameterBinding')}")
        return tuple(value for binding in bindings for value in self._binding(binding, what))

    def _binding(self, binding: ET.Element, what: str) -> Iterator[Assignment]:
        what = f"{self.place.label}: {what}: parameter binding"
        root, where = self._content(binding, "ssv:ParameterSet", _SET, what)
        prefix = binding.get("prefix", "")
        assignments = () if root is None else _parameter_set(root, where, self.definitions)
        values = [replace(value, name=prefix + value.name) for value in assignments]
        element = binding.find(tag("ssd:ParameterMapping"))
        mapping, where = (
            (None, "") if element is None else self._content(element, "ssm:ParameterMapping", _MAPPING, what)
        )
        yield from values if mapping is None else _mapped(values, mapping, where)

    def _content(self, element: ET.Element, root: str, kind: str, what: str) -> tuple[ET.Element | None, str]:
        """Return the parameter set or mapping that an element refers to or contains, and the file for messages."""
        if (given := element.get("type", kind)) != kind:
            raise InputError(f"{what}: the type {given!r} cannot be read; export it as {kind}")
        source = element.get("source")
        if source:
            content, where = self._file(element, source, what)
            return package.read_document(content, where, root), where
        found = element.find(tag(root))
        if found is None and (values := element.find(tag("ssd:ParameterValues"))) is not None:
            found = values.find(tag(root))
        if found is not None:
            package.check_version(found, what)
        return found, what

    def _file(self, element: ET.Element, source: str, what: str) -> tuple[bytes, str]:
        if element.get("sourceBase", "SSD") != "component":
            path, _ = self.place.resolve(source, what)
            return path.read_bytes(), f"{self.place.package}: {source}"
        if self.component is None:
            raise InputError(f"{what}: the source {source!r} is relative to a component, but this is a system")
        return read_inside(self.component, source, what), f"{self.place.package}: {self.component.name}: {source}"


def _mapped(values: Iterable[Assignment], mapping: ET.Element, where: str) -> Iterator[Assignment]:
    """Yield the values under their mapped names; a value without an entry keeps its own name, as in OMSimulator."""
    entries: dict[str, list[ET.Element]] = {}
    for entry in mapping.iterfind(tag("ssm:MappingEntry")):
        entries.setdefault(attribute(entry, "source", where), []).append(entry)
    for value in values:
        yield from (_transformed(value, entry, where) for entry in entries.get(value.name, ()))
        if value.name not in entries:
            yield value


def _parameter_set(root: ET.Element, where: str, outer: _Definitions) -> Iterator[Assignment]:
    definitions = outer.with_those_of(_Definitions.read(root, "ssv", where))
    for parameter in root.iterfind(f"{tag('ssv:Parameters')}/{tag('ssv:Parameter')}"):
        name = attribute(parameter, "name", where)
        kinds = [child for child in parameter if child.tag.startswith(tag("ssv:")) and child.get("value") is not None]
        if not kinds:
            raise InputError(f"{where}: parameter {name!r} has no value; give it one or remove it")
        yield Assignment(
            name=name,
            type=package.type_of(kinds[0]),
            value=_value(kinds[0], f"{where}: parameter {name!r}"),
            where=where,
            unit=package.unit_of(kinds[0], definitions.units),
            items=definitions.enumerations.get(kinds[0].get("name", ""), {}),
        )


def _value(kind: ET.Element, where: str) -> Value:
    match package.type_of(kind):
        case "Real":
            return number(kind, "value", where)
        case "Integer":
            return integer(kind, "value", where)
        case "Boolean":
            return flag(kind, "value", where, None)
        case _:
            return attribute(kind, "value", where)


def _transformation_of(element: ET.Element, where: str) -> Conversion:
    """Return the linear transformation of a connection or mapping entry; the identity if it has no transformation."""
    linear = element.find(tag("ssc:LinearTransformation"))
    if linear is None:
        return Conversion()
    return Conversion(number(linear, "factor", where, 1.0), number(linear, "offset", where, 0.0))


def _transformed(value: Assignment, entry: ET.Element, where: str) -> Assignment:
    """Return a value under its new name; a table is applied here, a linear transformation after the units."""
    target = attribute(entry, "target", where)
    where = f"{where}: {value.name} -> {target}"
    changed = replace(
        value,
        name=target,
        suppressed=flag(entry, "suppressUnitConversion", where),
        transformation=_transformation_of(entry, where),
    )
    for kind in ("Boolean", "Integer", "Enumeration"):
        table = entry.find(tag(f"ssc:{kind}MappingTransformation"))
        if table is not None:
            return replace(changed, value=_looked_up(table, kind, value.value, where))
    return changed


def _looked_up(table: ET.Element, kind: str, value: Value, where: str) -> Value:
    for entry in table.iterfind(tag("ssc:MapEntry")):
        if _entry(entry, "source", kind, where) == value:
            return _entry(entry, "target", kind, where)
    raise InputError(f"{where}: the table has no entry for {value!r}; add one")


def _entry(entry: ET.Element, end: str, kind: str, where: str) -> Value:
    if kind == "Boolean":
        return flag(entry, end, where, None)
    return integer(entry, end, where) if kind == "Integer" else attribute(entry, end, where)


# ---- SystemStructure.ssd as a structure, with the descriptions and packages that it refers to inserted --------------

_FMU, _SSD, _SSP = "application/x-fmu-sharedlibrary", "application/x-ssp-definition", "application/x-ssp-package"
_SUFFIXES = {".ssd": _SSD, ".ssp": _SSP}
_KINDS = ("input", "output", "parameter", "calculatedParameter", "inout")
_KINDS_2 = ("structuralParameter", "constant", "local", "unspecified")
#: Step of a master in other tools' annotations: OMSimulator's and the Open Simulation Platform's.
_STEPS = {"FixedStepAlgorithm": "baseStepSize", "FixedStepMaster": "stepSize"}


def read_structure(place: Place) -> Structure:
    """Read a description.

    Raises:
        InputError: A file is missing or wrong.
        WiringError: The description contains something that is not supported; the message names the element.
    """
    reader = _Reader.open(place, (f"{place.description}#",))
    name = reader.root.get("name") or reader.top.get("name") or place.description.stem
    return Structure(name, reader.system(reader.top), reader.experiment())


@dataclass(frozen=True)
class _Reader:
    """Reader of one description."""

    place: Place  #: File of the description.
    root: ET.Element  #: Root element.
    stack: tuple[str, ...]  #: Descriptions that led to this one, to detect one that contains itself.

    @classmethod
    def open(cls, place: Place, stack: tuple[str, ...]) -> _Reader:
        content = place.description.read_bytes()
        return cls(place, package.read_document(content, place.label, "ssd:SystemStructureDescription"), stack)

    @cached_property
    def definitions(self) -> _Definitions:
        return _Definitions.read(self.root, "ssd", self.place.label)

    @property
    def top(self) -> ET.Element:
        system = self.root.find(tag("ssd:System"))
        if system is None:
            raise InputError(f"{self.place.label}: it contains no System; export the package again")
        return system

    def system(self, element: ET.Element) -> SystemElement:
        name = attribute(element, "name", self.place.label)
        what = f"system {name!r}"
        where = f"{self.place.label}: {what}"
        _refuse_dictionaries(element, where)
        elements = tuple(self._elements(element))
        names = [child.name for child in elements]
        if doubled := sorted({n for n in names if names.count(n) > 1}):
            raise WiringError(f"{where}: two elements are named {doubled[0]!r}; rename one")
        links = element.iterfind(f"{tag('ssd:Connections')}/{tag('ssd:Connection')}")
        return SystemElement(
            name=name,
            connectors=self._connectors(element, where),
            values=self._values(element, what),
            elements=elements,
            links=tuple(_link(link, where) for link in links),
            where=where,
        )

    def _elements(self, system: ET.Element) -> Iterator[FmuElement | SystemElement]:
        for element in system.iterfind(f"{tag('ssd:Elements')}/*"):
            if element.tag == tag("ssd:System"):
                yield self.system(element)
            elif element.tag == tag("ssd:Component"):
                yield self._component(element)

    def _component(self, element: ET.Element) -> FmuElement | SystemElement:
        name = attribute(element, "name", self.place.label)
        what = f"{self.place.label}: component {name!r}"
        source = attribute(element, "source", what)
        if source.startswith("#"):
            return self._same_document(element, source)
        path, fragment = self.place.resolve(source, what)
        # Some tools omit the type of a nested package, although it is then an FMU by default.
        kind = _SUFFIXES.get(path.suffix.lower(), _FMU) if element.get("type", _FMU) == _FMU else element.get("type")
        if kind == _FMU:
            return self._fmu(element, name, path, source)
        if kind not in _SUFFIXES.values():
            raise WiringError(f"{what}: the type {kind!r} is not supported; export it as an FMU")
        return self._nested(element, path, fragment)

    def _fmu(self, element: ET.Element, name: str, path: Path, source: str) -> FmuElement:
        what = f"component {name!r}"
        where = f"{self.place.label}: {what}"
        if element.get("implementation") == "ModelExchange":
            raise WiringError(
                f"{where}: requires model exchange; export the FMU for co-simulation and set implementation accordingly"
            )
        with named(path, f"{self.place.package}: {source}"):
            values = self._values(element, what, path)
        connectors = self._connectors(element, where)
        return FmuElement(name, connectors, values, path, f"{where} ({source})", self.place.unpacked)

    def _nested(self, element: ET.Element, path: Path, fragment: str) -> SystemElement:
        """Return the top system of another description in place of the component."""
        label = f"{self.place.package}: {element.get('source')}"
        key = f"{path}#{fragment}"
        if key in self.stack:
            raise WiringError(
                f"{self.place.label}: component {element.get('name')!r}: {label} contains itself; remove one of the two"
            )
        bare = path.suffix.lower() == ".ssd"
        place = self.place.inner(path, label) if bare else open_package(path, label, fragment)
        reader = _Reader.open(place, (*self.stack, key))
        return self._in_place_of(element, reader.system(reader.top), path)

    def _same_document(self, element: ET.Element, source: str) -> SystemElement:
        systems = [s for s in self.root.iter(tag("ssd:System")) if s.get("id") == source[1:]]
        where = f"{self.place.label}: component {element.get('name')!r}"
        if len(systems) != 1:
            raise InputError(f"{where}: there is no system with the id {source[1:]!r} in this file; correct the source")
        key = f"{self.place.description}{source}"
        if key in self.stack:
            raise WiringError(f"{where}: the system {source!r} contains itself; remove one of the two")
        reader = replace(self, stack=(*self.stack, key))
        return self._in_place_of(element, reader.system(systems[0]), None)

    def _in_place_of(self, element: ET.Element, system: SystemElement, path: Path | None) -> SystemElement:
        """Give a system the component's name; the component's values come last and take precedence."""
        name = attribute(element, "name", self.place.label)
        return replace(system, name=name, values=system.values + self._values(element, f"component {name!r}", path))

    def _values(self, element: ET.Element, what: str, path: Path | None = None) -> tuple[Assignment, ...]:
        return _Bindings(self.place, self.definitions, path).read(element, what)

    def _connectors(self, element: ET.Element, where: str) -> dict[str, Connector]:
        connectors = {}
        for connector in element.iterfind(f"{tag('ssd:Connectors')}/{tag('ssd:Connector')}"):
            name, kind = attribute(connector, "name", where), attribute(connector, "kind", where)
            if kind not in _KINDS + _KINDS_2:
                kinds = ", ".join(_KINDS + _KINDS_2)
                raise InputError(f"{where}: connector {name!r} has the kind {kind!r}; SSP defines {kinds}")
            types = [child for child in connector if child.tag.startswith(tag("ssc:"))]
            unit = package.unit_of(types[0], self.definitions.units) if types else None
            connectors[name] = Connector(name, kind, package.type_of(types[0]) if types else None, unit)
        return connectors

    def experiment(self) -> Experiment:
        """Read the times, and the step from the annotations of OMSimulator or the Open Simulation Platform."""
        where = f"{self.place.label}: DefaultExperiment"
        found = self.root.find(tag("ssd:DefaultExperiment"))
        step = self._step()
        if found is None:
            return Experiment(step=step)
        stop = number(found, "stopTime", where) if found.get("stopTime") else None
        return Experiment(number(found, "startTime", where, 0.0), stop, step)

    def _step(self) -> float | None:
        for parent in (self.root.find(tag("ssd:DefaultExperiment")), self.top, self.root):
            annotations = None if parent is None else parent.find(tag("ssd:Annotations"))
            for element in () if annotations is None else annotations.iter():
                name = _STEPS.get(local_name(element))
                if name is not None and element.get(name) is not None:
                    return self._positive(element, name)
        return None

    def _positive(self, element: ET.Element, name: str) -> float:
        step = number(element, name, self.place.label)
        if not (isfinite(step) and step > 0.0):
            raise InputError(
                f"{self.place.label}: {local_name(element)} has {name} = {step!r}, which is not a step [s]; correct it"
            )
        return step


def _link(link: ET.Element, where: str) -> Link:
    ends = (
        (link.get("startElement") or None, attribute(link, "startConnector", where)),
        (link.get("endElement") or None, attribute(link, "endConnector", where)),
    )
    transforms = link.find(tag("ssc:LinearTransformation")) is not None
    result = Link(ends, flag(link, "suppressUnitConversion", where), _transformation_of(link, where), where, transforms)
    for kind in ("Boolean", "Integer", "Enumeration"):
        if link.find(tag(f"ssc:{kind}MappingTransformation")) is not None:
            raise WiringError(
                f"{where}: connection {result}: {kind} tables are not supported, only linear transformations of Real "
                "values; replace it"
            )
    return result


def _refuse_dictionaries(system: ET.Element, where: str) -> None:
    reference = system.find(f"{tag('ssd:Elements')}/{tag('ssd:SignalDictionaryReference')}")
    if reference is not None:
        raise WiringError(
            f"{where}: {reference.get('name')!r} is a signal dictionary, which is not supported; connect the "
            "components directly and export again"
        )
