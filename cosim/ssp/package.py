"""Files of SSP packages, and what a description contains before any FMU is opened."""

from __future__ import annotations

import os.path
import shutil
import tempfile
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from urllib.parse import SplitResult, unquote, urlsplit
from urllib.request import url2pathname

from cosim.components.component import EXPONENTS, Conversion, UnitDefinition
from eightpost.archive import extract_archive, read_archive
from eightpost.errors import FmuError, InputError
from eightpost.files import is_file

# ---- XML of SSP files -----------------------------------------------------------------------------------------------

_NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
}
#: Types of SSP 2.0 and FMI 3.0 that components have under other names.
_TYPES = {"Float64": "Real", "Float32": "Real"} | {
    f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)
}


Read = TypeVar("Read")


class _DoctypeError(Exception):
    """Error for a document type, which can declare entities that expand without limit or read other files."""


class _Builder(ET.TreeBuilder):
    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise _DoctypeError


def tag(name: str) -> str:
    """Return the full name of an element: `ssd:System`; files may use any prefix for a namespace."""
    prefix, _, local = name.partition(":")
    return f"{{{_NAMESPACES[prefix]}}}{local}"


def read_document(content: bytes, where: str, root: str) -> ET.Element:
    """Read an XML file of SSP 1.x or 2.x, which share their namespaces.

    Raises:
        InputError: The file is not XML, declares a document type, or has another root element or SSP version.
    """
    try:
        element = ET.fromstring(content, parser=ET.XMLParser(target=_Builder()))
    except _DoctypeError:
        raise InputError(
            f"{where}: declares a document type (DOCTYPE), which is not allowed in SSP; remove it"
        ) from None
    except (ET.ParseError, LookupError, ValueError) as error:
        raise InputError(f"{where}: is not a readable XML file ({error}); export it again") from error
    if element.tag != tag(root):
        raise InputError(f"{where}: its root element is {element.tag}, not {tag(root)}; export it as SSP 1.0 or 2.0")
    check_version(element, where)
    return element


def check_version(element: ET.Element, where: str) -> None:
    """Refuse versions other than SSP 1.x and 2.x.

    Raises:
        InputError: It is another version.
    """
    version = element.get("version", "1.0")
    if not version.startswith(("1.", "2.")):
        raise InputError(f"{where}: is SSP {version}; only SSP 1.0 and 2.0 are supported; export it as one of these")


def attribute(element: ET.Element, name: str, where: str) -> str:
    """Return a required attribute.

    Raises:
        InputError: The element has no such attribute.
    """
    value = element.get(name)
    if value is None:
        raise InputError(f"{where}: a {local_name(element)} has no attribute {name!r}; export the package again")
    return value


_FLAGS = {"true": True, "1": True, "false": False, "0": False}


def _converted(
    element: ET.Element, name: str, where: str, convert: Callable[[str], Read], what: str, default: Read | None = None
) -> Read:
    if default is not None and element.get(name) is None:
        return default
    text = attribute(element, name, where)
    try:
        return convert(text)
    except (ValueError, KeyError):
        raise InputError(f"{where}: {local_name(element)} {name}={text!r} is {what}; correct it") from None


def number(element: ET.Element, name: str, where: str, default: float | None = None) -> float:
    """Return an attribute as a number.

    Raises:
        InputError: It is not a number, or is missing without a default.
    """
    return _converted(element, name, where, float, "not a number", default)


def integer(element: ET.Element, name: str, where: str) -> int:
    """Return an attribute as a whole number.

    Raises:
        InputError: It is not a whole number, or is missing.
    """
    return _converted(element, name, where, int, "not a whole number")


def flag(element: ET.Element, name: str, where: str, default: bool | None = False) -> bool:
    """Return an attribute as a Boolean.

    Raises:
        InputError: It is neither true nor false, or is missing without a default.
    """
    return _converted(element, name, where, lambda text: _FLAGS[text.strip()], "neither true nor false", default)


def local_name(element: ET.Element) -> str:
    """Return an element's name without its namespace."""
    return element.tag.rpartition("}")[2]


def type_of(element: ET.Element) -> str:
    """Return the type of an element by its name for components."""
    return _TYPES.get(local_name(element), local_name(element))


def read_units(root: ET.Element, units: str, where: str) -> dict[str, UnitDefinition]:
    """Return the units that a file defines; a unit without base units is looked up by its name later."""
    definitions = {}
    for unit in root.iterfind(f"{tag(units)}/{tag('ssc:Unit')}"):
        name, base = attribute(unit, "name", where), unit.find(tag("ssc:BaseUnit"))
        definitions[name] = UnitDefinition(name, {"?": 1}) if base is None else _definition(name, base, where)
    return definitions


def _definition(name: str, base: ET.Element, where: str) -> UnitDefinition:
    place = f"{where}: unit {name!r}"
    exponents = {key: integer(base, key, place) for key in EXPONENTS if base.get(key, "0").strip() != "0"}
    factor, offset = number(base, "factor", place, 1.0), number(base, "offset", place, 0.0)
    if factor == 0.0:
        raise InputError(f"{place} has the factor 0; correct it")
    return UnitDefinition(name, exponents, factor, offset)


def unit_of(element: ET.Element | None, units: Mapping[str, UnitDefinition]) -> UnitDefinition | None:
    """Return the unit that a Real element names; None if it names none."""
    name = None if element is None else element.get("unit")
    return None if not name else units.get(name, UnitDefinition(name, {"?": 1}))


def read_enumerations(root: ET.Element, element: str, where: str) -> dict[str, dict[str, int]]:
    """Return the enumerations that a file defines: name -> item -> value."""
    return {
        attribute(enumeration, "name", where): {
            attribute(item, "name", where): integer(item, "value", where)
            for item in enumeration.iterfind(tag("ssc:Item"))
        }
        for enumeration in root.iterfind(f"{tag(element)}/{tag('ssc:Enumeration')}")
    }


# ---- Files of a package ---------------------------------------------------------------------------------------------

DEFAULT = "SystemStructure.ssd"


class Unpacked:
    """Folder of an unpacked archive; it is removed with the last object that refers to it."""

    def __init__(self, archive: Path) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="ssp_"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        extract_archive(archive, self.folder)


@dataclass(frozen=True)
class Place:
    """Description and the location of its files."""

    description: Path  #: Description file (.ssd); sources are relative to its folder.
    #: Folder that relative sources must not leave; None for a bare description, whose files may be in other folders.
    root: Path | None
    label: str  #: Display name of the file for messages: `car.ssp: SystemStructure.ssd`.
    package: str  #: Name of the archive alone; equal to `label` for a bare description.
    #: Folder that must exist as long as the files are used; None for a bare description.
    unpacked: Unpacked | None = None

    def resolve(self, source: str, what: str) -> tuple[Path, str]:
        """Return the file of a source (a URI) and its fragment.

        Args:
            source: Source as written in the description: relative to it, or file:///...; both percent-encoded.
            what: Description and element, for messages.

        Raises:
            InputError: The source is not such a URI, is outside the package, or the file does not exist.
        """
        what = f"{what}: "
        parts = _split(source)
        if parts.scheme not in ("", "file") or parts.netloc not in ("", "localhost") or "\\" in source:
            raise InputError(
                f"{what}the source {source!r} is neither relative, with forward slashes, nor a file:/// address; put "
                "the file into the package and name it as for example 'resources/shock.fmu'"
            )
        if parts.scheme:
            paths = {Path(url2pathname(parts.path)): unquote(parts.fragment)}
        else:
            paths = self._relative(source, what)
        for path, fragment in paths.items():
            if is_file(path):
                return path, fragment
        raise InputError(f"{what}there is no file {source!r}; add it, or correct the source (names are case-sensitive)")

    def _relative(self, source: str, what: str) -> dict[Path, str]:
        """Return the possible meanings of a relative source: a URI, or a plain name that is not encoded."""
        parts = _split(source)
        names = {source: "", parts.path: unquote(parts.fragment), unquote(parts.path): unquote(parts.fragment)}
        paths = {Path(os.path.normpath(self.description.parent / name)): names[name] for name in reversed(names)}
        if self.root is not None and not all(path.is_relative_to(self.root) for path in paths):
            raise InputError(f"{what}the source {source!r} is outside the package; put the file into it")
        return paths

    def inner(self, description: Path, label: str) -> Place:
        """Return the place of another description in this package."""
        return Place(description, self.root, label, self.package, self.unpacked)


def _split(source: str) -> SplitResult:
    """Return the parts of a URI; a text that is not a URI is returned as a path, for which there is no file."""
    try:
        return urlsplit(source)
    except ValueError:
        return SplitResult("", "", source, "", "")


def open_package(path: Path, label: str, description: str = "") -> Place:
    """Unpack an .ssp, or use an .ssd in its folder.

    Args:
        path: Package or description file.
        label: Name of the file for messages.
        description: Description (.ssd) to read from an archive; SystemStructure.ssd by default.

    Raises:
        InputError: The file is missing, is not an archive, is unsafe, or has no such description.
    """
    if path.suffix.lower() == ".ssd":
        if not is_file(path):
            raise InputError(f"{label}: there is no such file")
        file = Path(os.path.normpath(path.absolute()))
        return Place(file, None, label, label)
    with named(path, label):
        unpacked = Unpacked(path)
    name = description or DEFAULT
    file = Path(os.path.normpath(unpacked.folder / name))
    if not (is_file(file) and file.is_relative_to(unpacked.folder)):
        held = sorted(str(p.relative_to(unpacked.folder)) for p in unpacked.folder.rglob("*.ssd"))
        advice = (
            f"it contains {', '.join(held)}: unpack it and run one of these" if held else "it is not an SSP package"
        )
        raise InputError(f"{label}: there is no {name} in the archive; {advice}")
    return Place(file, unpacked.folder, f"{label}: {name}", label, unpacked)


@contextmanager
def named(path: Path, label: str) -> Iterator[None]:
    """Replace the path of an unpacked file in errors by its name in the package."""
    try:
        yield
    except FmuError as error:
        raise FmuError(str(error).replace(str(path), label)) from error


def read_inside(archive: Path, member: str, what: str) -> bytes:
    """Return a file from inside a component's own archive.

    Raises:
        InputError: There is no such file.
    """
    members = read_archive(archive)
    name = os.path.normpath(unquote(_split(member).path)).replace(os.sep, "/")
    if name not in members:
        raise InputError(f"{what}: there is no file {member!r} in {archive.name}; correct the source")
    return members[name]


# ==== Contents =======================================================================================================

Value = float | int | bool | str


@dataclass(frozen=True)
class Connector:
    """Connector of an element; kind is input, output, parameter ..."""

    name: str
    kind: str
    type: str | None = None
    unit: UnitDefinition | None = None


@dataclass(frozen=True)
class Link:
    """Connection of two connectors of a system or its elements; the order of the ends does not show the direction."""

    #: Two pairs (element, connector); element is None for the system itself.
    ends: tuple[tuple[str | None, str], tuple[str | None, str]]
    suppressed: bool  #: Whether unit conversion is suppressed.
    transformation: Conversion  #: Conversion applied after that of units: `target = factor * source + offset`.
    where: str  #: File and system, for messages.
    transforms: bool = False  #: Whether the description has a transformation, even one that changes nothing.

    def __str__(self) -> str:
        """Return the ends as the description writes them."""
        return " -> ".join(f"{element}.{connector}" if element else connector for element, connector in self.ends)


@dataclass(frozen=True)
class Assignment:
    """Value from a parameter set."""

    name: str  #: Name of the variable, relative to the element that the set is bound to.
    type: str  #: Real, Integer, Boolean, String, Enumeration or Binary.
    value: Value  #: Value; for an enumeration the name of the item.
    where: str  #: File, for messages.
    unit: UnitDefinition | None = None  #: Unit of the value; None: that of the variable.
    suppressed: bool = False  #: Whether unit conversion is suppressed.
    transformation: Conversion = field(default_factory=Conversion)  #: Conversion applied after that of units.
    items: Mapping[str, int] = field(default_factory=dict)  #: Items of the enumeration, as the file defines it.


@dataclass(frozen=True)
class FmuElement:
    """Component that is an FMU."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    path: Path
    where: str
    unpacked: Unpacked | None


@dataclass(frozen=True)
class SystemElement:
    """System with elements, and links between them and its own connectors."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    elements: tuple[FmuElement | SystemElement, ...]
    links: tuple[Link, ...]
    where: str


@dataclass(frozen=True)
class Experiment:
    """Times of the run in a description [s]; None if not stated."""

    start: float = 0.0
    stop: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Structure:
    """Description: its top system and its experiment."""

    name: str
    system: SystemElement
    experiment: Experiment
