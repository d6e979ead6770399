"""Parameter sets (.ssv or inline) and mappings (.ssm or inline) as assignments."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cosim.component import UnitDefinition
from cosim.conversion import Conversion
from cosim.ssp import document
from cosim.ssp.document import attribute, flag, integer, number, tag
from cosim.ssp.package import Place, read_inside
from cosim.ssp.structure import Assignment, Value
from eightpost.errors import InputError

_SET, _MAPPING = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class Definitions:
    """Units and enumerations that a file defines."""

    units: Mapping[str, UnitDefinition]
    enumerations: Mapping[str, Mapping[str, int]]

    @classmethod
    def read(cls, root: ET.Element, prefix: str, where: str) -> Definitions:
        """Read the definitions from a file's root element."""
        return cls(
            document.read_units(root, f"{prefix}:Units", where),
            document.read_enumerations(root, f"{prefix}:Enumerations", where),
        )

    def with_those_of(self, other: Definitions) -> Definitions:
        """Return the definitions of both; the other's take precedence."""
        return Definitions({**self.units, **other.units}, {**self.enumerations, **other.enumerations})


@dataclass(frozen=True)
class Bindings:
    """Reader of the parameter bindings of an element.

    Args:
        place: Description that contains the bindings.
        definitions: Units and enumerations of the description, for inline values that name them.
        component: Archive of the component, for sources that are inside it.
    """

    place: Place
    definitions: Definitions
    component: Path | None

    def read(self, element: ET.Element, what: str) -> tuple[Assignment, ...]:
        """Return the values of an element's bindings, in order.

        Raises:
            InputError: A file is missing or wrong.
        """
        bindings = element.iterfind(f"{tag('ssd:ParameterBindings')}/{tag('ssd:ParameterBinding')}")
        return tuple(value for binding in bindings for value in self._binding(binding, what))

    def _binding(self, binding: ET.Element, what: str) -> Iterator[Assignment]:
        what = f"{self.place.label}: {what}: parameter binding"
        root, where = self._content(binding, "ssv:ParameterSet", _SET, what)
        prefix = binding.get("prefix", "")
        found = () if root is None else _parameter_set(root, where, self.definitions)
        values = [replace(value, name=prefix + value.name) for value in found]
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
            return document.read_document(content, where, root), where
        found = element.find(tag(root))
        if found is None and (values := element.find(tag("ssd:ParameterValues"))) is not None:
            found = values.find(tag(root))
        if found is not None:
            document.check_version(found, what)
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


def _parameter_set(root: ET.Element, where: str, outer: Definitions) -> Iterator[Assignment]:
    definitions = outer.with_those_of(Definitions.read(root, "ssv", where))
    for parameter in root.iterfind(f"{tag('ssv:Parameters')}/{tag('ssv:Parameter')}"):
        name = attribute(parameter, "name", where)
        kinds = [child for child in parameter if child.tag.startswith(tag("ssv:")) and child.get("value") is not None]
        if not kinds:
            raise InputError(f"{where}: parameter {name!r} has no value; give it one or remove it")
        yield Assignment(
            name=name,
            type=document.type_of(kinds[0]),
            value=_value(kinds[0], f"{where}: parameter {name!r}"),
            where=where,
            unit=document.unit_of(kinds[0], definitions.units),
            items=definitions.enumerations.get(kinds[0].get("name", ""), {}),
        )


def _value(kind: ET.Element, where: str) -> Value:
    match document.type_of(kind):
        case "Real":
            return number(kind, "value", where)
        case "Integer":
            return integer(kind, "value", where)
        case "Boolean":
            return flag(kind, "value", where, None)
        case _:
            return attribute(kind, "value", where)


def transformation_of(element: ET.Element, where: str) -> Conversion:
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
        transformation=transformation_of(entry, where),
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
