"""SystemStructure.ssd as a structure, with the descriptions and packages that it refers to inserted."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from pathlib import Path

from cosim.ssp import document
from cosim.ssp.document import attribute, flag, local_name, number, tag
from cosim.ssp.package import Place, named, open_package
from cosim.ssp.parameters import Bindings, Definitions, transformation_of
from cosim.ssp.structure import Assignment, Connector, Experiment, FmuElement, Link, Structure, SystemElement
from eightpost.errors import InputError, WiringError

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
    """Reader of one description.

    Args:
        place: File of the description.
        root: Root element.
        stack: Descriptions that led to this one, to detect one that contains itself.
    """

    place: Place
    root: ET.Element
    stack: tuple[str, ...]

    @classmethod
    def open(cls, place: Place, stack: tuple[str, ...]) -> _Reader:
        content = place.description.read_bytes()
        return cls(place, document.read_document(content, place.label, "ssd:SystemStructureDescription"), stack)

    @cached_property
    def definitions(self) -> Definitions:
        return Definitions.read(self.root, "ssd", self.place.label)

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
        what = f"component {name!r}"
        source = attribute(element, "source", f"{self.place.label}: {what}")
        if source.startswith("#"):
            return self._same_document(element, source)
        path, fragment = self.place.resolve(source, what)
        # Some tools omit the type of a nested package, although it is then an FMU by default.
        kind = _SUFFIXES.get(path.suffix.lower(), _FMU) if element.get("type", _FMU) == _FMU else element.get("type")
        if kind == _FMU:
            return self._fmu(element, name, path, source)
        if kind not in _SUFFIXES.values():
            raise WiringError(f"{self.place.label}: {what}: the type {kind!r} is not supported; export it as an FMU")
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
        found = [s for s in self.root.iter(tag("ssd:System")) if s.get("id") == source[1:]]
        where = f"{self.place.label}: component {element.get('name')!r}"
        if len(found) != 1:
            raise InputError(f"{where}: there is no system with the id {source[1:]!r} in this file; correct the source")
        key = f"{self.place.description}{source}"
        if key in self.stack:
            raise WiringError(f"{where}: the system {source!r} contains itself; remove one of the two")
        reader = replace(self, stack=(*self.stack, key))
        return self._in_place_of(element, reader.system(found[0]), None)

    def _in_place_of(self, element: ET.Element, system: SystemElement, path: Path | None) -> SystemElement:
        """Give a system the component's name; the component's values come last and take precedence."""
        name = attribute(element, "name", self.place.label)
        return replace(system, name=name, values=system.values + self._values(element, f"component {name!r}", path))

    def _values(self, element: ET.Element, what: str, path: Path | None = None) -> tuple[Assignment, ...]:
        return Bindings(self.place, self.definitions, path).read(element, what)

    def _connectors(self, element: ET.Element, where: str) -> dict[str, Connector]:
        found = {}
        for connector in element.iterfind(f"{tag('ssd:Connectors')}/{tag('ssd:Connector')}"):
            name, kind = attribute(connector, "name", where), attribute(connector, "kind", where)
            if kind not in _KINDS + _KINDS_2:
                known = ", ".join(_KINDS + _KINDS_2)
                raise InputError(f"{where}: connector {name!r} has the kind {kind!r}; SSP defines {known}")
            types = [child for child in connector if child.tag.startswith(tag("ssc:"))]
            unit = document.unit_of(types[0], self.definitions.units) if types else None
            found[name] = Connector(name, kind, document.type_of(types[0]) if types else None, unit)
        return found

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
    found = Link(ends, flag(link, "suppressUnitConversion", where), transformation_of(link, where), where, transforms)
    for kind in ("Boolean", "Integer", "Enumeration"):
        if link.find(tag(f"ssc:{kind}MappingTransformation")) is not None:
            raise WiringError(
                f"{where}: connection {found}: {kind} tables are not supported, only linear transformations of Real "
                "values; replace it"
            )
    return found


def _refuse_dictionaries(system: ET.Element, where: str) -> None:
    reference = system.find(f"{tag('ssd:Elements')}/{tag('ssd:SignalDictionaryReference')}")
    if reference is not None:
        raise WiringError(
            f"{where}: {reference.get('name')!r} is a signal dictionary, which is not supported; connect the "
            "components directly and export again"
        )
