"""Rules for the content of an archive: entries, documents, terminals."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from builder.check.catalogue import static as rules
from builder.check.description import Variable
from builder.check.rules import Finding, listed
from builder.check.subject import XML, Subject
from eightpost.archive import unsafe_reason
from eightpost.extras import needs

# ---- Entries --------------------------------------------------------------------------------------------------------

_TOP = {XML, "model.png", "binaries", "sources", "documentation", "resources", "licenses", "terminalsAndIcons", "extra"}
_DECLARATION = re.compile(rb"""\A\s*<\?xml[^>]*encoding\s*=\s*["']([^"']+)["']""")


def _at_top(subject: Subject) -> Iterator[Finding]:
    """Check that modelDescription.xml is at the top of the archive."""
    if XML not in subject.members:
        found = next(name for name in subject.members if PurePosixPath(name.replace("\\", "/")).name == XML)
        yield rules.ROOT.finding(f"it is at {found!r}; nothing else could be checked")


def _paths(subject: Subject) -> Iterator[Finding]:
    """Check that no entry is outside the archive's folder."""
    for entry in subject.entries:
        if reason := unsafe_reason(entry):
            yield rules.PATHS.finding(f"the entry {entry.orig_filename!r} {reason}")


def _duplicates(subject: Subject) -> Iterator[Finding]:
    """Check that entries are unique, also if upper and lower case are ignored."""
    counts = Counter(entry.filename for entry in subject.entries)
    for name, count in counts.items():
        if count > 1:
            yield rules.DUPLICATES.finding(f"{name!r} occurs {count} times")
    folded = Counter(name.casefold() for name in counts)
    alike = sorted(name for name in counts if folded[name.casefold()] > 1)
    if alike:
        yield rules.CASE.finding(f"{listed(alike)} are the same file on some systems")


def _compression(subject: Subject) -> Iterator[Finding]:
    """Check that entries are deflated or stored."""
    odd = [e.filename for e in subject.entries if e.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)]
    if odd:
        yield rules.COMPRESSION.finding(f"compressed with other methods: {listed(odd)}")


def _dates(subject: Subject) -> Iterator[Finding]:
    """Check that all entries have the same date."""
    found = sorted({entry.date_time for entry in subject.entries})
    if len(found) > 1:
        first, last = ("{:04}-{:02}-{:02} {:02}:{:02}:{:02}".format(*date) for date in (found[0], found[-1]))
        yield rules.DATES.finding(f"its entries have {len(found)} dates, from {first} to {last}")


def _stray(subject: Subject) -> Iterator[Finding]:
    """Check that there are no unknown files at the top of the archive."""
    foreign = sorted({part for name in subject.members for part in PurePosixPath(name).parts[:1]} - _TOP - {"/"})
    if XML in subject.members and foreign:
        yield rules.STRAY.finding(f"unknown: {listed(foreign)}")


def _well_formed(subject: Subject) -> Iterator[Finding]:
    """Check that the XML can be parsed."""
    if subject.xml_error:
        yield rules.WELL_FORMED.finding(f"{subject.xml_error}; its content could not be checked")


def _encoding(subject: Subject) -> Iterator[Finding]:
    """Check that the XML is UTF-8."""
    content = subject.members.get(XML, b"").removeprefix(b"\xef\xbb\xbf")
    declared = _DECLARATION.match(content)
    if declared and declared[1].lower() not in (b"utf-8", b"utf8"):
        yield rules.ENCODING.finding(f"it declares {declared[1].decode('latin-1')}")


ENTRY_RULES = (_at_top, _paths, _duplicates, _compression, _dates, _stray, _well_formed, _encoding)


# ---- Documents, sources, reference results --------------------------------------------------------------------------

_PNG = b"\x89PNG\r\n\x1a\n"


def _sources(subject: Subject) -> Iterator[Finding]:
    """Check that the listed sources exist."""
    listed_files = subject.description.source_files if subject.description else ()
    missing = [name for name in listed_files if f"sources/{name}" not in subject.members]
    if missing:
        yield rules.SOURCE_FILES.finding(f"missing in sources/: {listed(missing)}")
    if not listed_files:
        yield rules.SOURCES.finding("no sources are listed")


def _documents(subject: Subject) -> Iterator[Finding]:
    """Check that documentation and licence exist and are not empty."""
    page = subject.members.get("documentation/index.html")
    if page is None:
        yield rules.DOCUMENTATION.finding("it is missing")
    elif not page.strip():
        yield rules.DOCUMENTATION.finding("it is empty")
    licences = [name for name in subject.members if name.startswith(("documentation/licenses/", "licenses/"))]
    if not licences:
        yield rules.LICENSE.finding("it is missing")
    if empty := [name for name in licences if not subject.members[name].strip()]:
        yield rules.LICENSE.finding(f"empty: {listed(empty)}")


def _icon(subject: Subject) -> Iterator[Finding]:
    """Check that the icon exists and can be decoded."""
    version_3 = subject.description is not None and subject.description.fmi == 3
    content = subject.members.get("terminalsAndIcons/icon.png" if version_3 else "model.png")
    if content is None:
        yield rules.ICON.finding("it is missing")
    elif not content.startswith(_PNG):
        yield rules.ICON_FORMAT.finding("it does not start with a PNG signature")
    elif fault := _fault_of_png(content):
        yield rules.ICON_FORMAT.finding(fault)


#: Maximum number of pixels that are decoded: a file of a few kilobytes can decode to gigabytes of one colour.
_MOST_PIXELS = 2**24


def _fault_of_png(content: bytes) -> str:
    with needs("check", "checking the icon of an FMU"):
        from PIL import Image  # noqa: PLC0415 - only a file with an icon needs it

    try:
        with Image.open(io.BytesIO(content), formats=("PNG",)) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                return f"it has {picture.width} x {picture.height} pixels, too many to be decoded"
            picture.load()
    except Exception as error:  # an exception of the decoder is a finding
        return f"it cannot be decoded: {str(error).partition(' <')[0]}"
    return ""


def _reference(subject: Subject) -> Iterator[Finding]:
    """Check that there are reference results."""
    if not any(name.startswith("extra/") and name.endswith("_ref.csv") for name in subject.members):
        yield rules.REFERENCE_GIVEN.finding("there is no extra/.../*_ref.csv")


def _file_name(subject: Subject) -> Iterator[Finding]:
    """Check that the file is named after the modelIdentifier."""
    identifier = subject.description.identifier if subject.description else ""
    if identifier and subject.path.stem != identifier:
        yield rules.FILE_NAME.finding(f"the file is {subject.path.name}, the modelIdentifier {identifier}")


CONTENT_RULES = (_sources, _documents, _icon, _reference, _file_name)


# ---- Terminals ------------------------------------------------------------------------------------------------------

_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
_FLOWS = ("inflow", "outflow")

#: Flow of a force by its causality: a force that is positive in compression leaves the shock and enters the vehicle.
_FLOW_OF_FORCE = {"output": "outflow", "input": "inflow"}


@dataclass(frozen=True)
class _Member:
    """A member of a terminal: its kind of connection, and its variable."""

    kind: str
    variable: Variable


def _terminals(subject: Subject) -> Iterator[Finding]:
    """Check that terminals can be read and refer to existing variables."""
    content = subject.members.get(_PATH)
    if content is None:
        yield rules.TERMINALS.finding(f"{_PATH} is missing")
        return
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        yield rules.TERMINALS_VALID.finding(f"{_PATH}: {error}")
        return
    yield from _named(subject, root)
    variables = subject.description.by_name if subject.description else {}
    for terminal in root.iter("Terminal"):
        for fault in _contradictions(_members(terminal, variables)):
            yield rules.TERMINALS_FIT.finding(f"terminal {terminal.get('name', '')!r}: {fault}")


def _named(subject: Subject, root: ET.Element) -> Iterator[Finding]:
    variables = subject.description.by_name if subject.description else {}
    named = [e.get("variableName", "") for e in root.iter("TerminalMemberVariable")]
    if unknown := [name for name in named if name not in variables]:
        yield rules.TERMINALS_VALID.finding(f"unknown variables: {listed(unknown)}")
    if root.find("Terminals/Terminal") is None:
        yield rules.TERMINALS_VALID.finding("it contains no Terminal")
    folder = PurePosixPath(_PATH).parent
    icons = [e.get("iconBaseName", "") for e in root.iter("TerminalGraphicalRepresentation")]
    missing = [name for name in icons if name and str(folder / f"{name}.png") not in subject.members]
    if missing:
        yield rules.TERMINALS_VALID.finding(f"missing icons: {listed(missing)}")


def _members(terminal: ET.Element, variables: Mapping[str, Variable]) -> dict[str, _Member]:
    """Return the members with existing variables by their names in the terminal."""
    found = {}
    for element in terminal.iterfind("TerminalMemberVariable"):
        name, variable = element.get("variableName", ""), variables.get(element.get("variableName", ""))
        if variable is not None:
            found[element.get("memberName", name)] = _Member(element.get("variableKind", ""), variable)
    return found


def _contradictions(members: Mapping[str, _Member]) -> Iterator[str]:
    for member in members.values():
        causality = member.variable.causality
        if causality in ("local", "independent"):
            yield f"{member.variable.name} is {causality}; such variables cannot be connected"
        elif member.kind in _FLOWS and causality not in ("input", "output"):
            yield f"{member.variable.name} is an {member.kind} and a {causality}; flows are inputs or outputs"
    velocity, force = members.get("velocity"), members.get("force")
    if velocity and force and (velocity.variable.unit, force.variable.unit) == ("m/s", "N"):
        yield from _port(members, velocity, force)


def _port(members: Mapping[str, _Member], velocity: _Member, force: _Member) -> Iterator[str]:
    """Yield contradictions at a port: motions and force must have opposite causality (docs/reference/ports.md)."""
    causality, flow = force.variable.causality, _FLOW_OF_FORCE.get(force.variable.causality)
    if flow and force.kind in _FLOWS and force.kind != flow:
        yield f"{force.variable.name} is an {causality}, and so an {flow}, not an {force.kind}"
    motions = [member for member in (velocity, members.get("displacement")) if member is not None]
    for motion in motions:
        if motion.variable.causality == causality:
            yield f"{motion.variable.name} and {force.variable.name} are both {causality}s; one must be the opposite"
        if motion.kind in _FLOWS:
            yield f"{motion.variable.name} is equal on both sides, and so a signal, not an {motion.kind}"


TERMINAL_RULES = (_terminals,)
