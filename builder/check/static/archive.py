"""Rules for the content of an archive: entries, documents, terminals, sources."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

from builder.check.rules import Faults, some
from builder.check.subject import XML, Subject
from eightpost.archive import unsafe_reason
from eightpost.extras import needs
from eightpost.fmi.description import Description, Variable

# ---- Entries --------------------------------------------------------------------------------------------------------

_TOP = {XML, "model.png", "binaries", "sources", "documentation", "resources", "licenses", "terminalsAndIcons", "extra"}
_DECLARATION = re.compile(rb"""\A\s*<\?xml[^>]*encoding\s*=\s*["']([^"']+)["']""")
_DATE = "{:04}-{:02}-{:02} {:02}:{:02}:{:02}"


def entries(subject: Subject) -> Faults:
    """Yield faults of the entries of the archive, and of the XML as text."""
    if XML not in subject.members:
        found = next(name for name in subject.members if PurePosixPath(name.replace("\\", "/")).name == XML)
        yield "archive-root", f"it is at {found!r}; nothing else could be checked"
    for entry in subject.entries:
        if reason := unsafe_reason(entry):
            yield "archive-path", f"the entry {entry.orig_filename!r} {reason}"
    counts = Counter(entry.filename for entry in subject.entries)
    for name, count in counts.items():
        if count > 1:
            yield "archive-duplicate", f"{name!r} occurs {count} times"
    folded = Counter(name.casefold() for name in counts)
    alike = sorted(name for name in counts if folded[name.casefold()] > 1)
    yield "archive-case", some(alike, after=" are the same file on some systems")
    plain = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    odd = (entry.filename for entry in subject.entries if entry.compress_type not in plain)
    yield "archive-compression", some(odd, "compressed with other methods: ")
    dates = sorted({entry.date_time for entry in subject.entries})
    if len(dates) > 1:
        first, last = _DATE.format(*dates[0]), _DATE.format(*dates[-1])
        yield "archive-dates", f"its entries have {len(dates)} dates, from {first} to {last}"
    if XML in subject.members:
        foreign = {part for name in subject.members for part in PurePosixPath(name).parts[:1]} - _TOP - {"/"}
        yield "archive-stray", some(sorted(foreign), "unknown: ")
    if subject.xml_error:
        yield "xml-wellformed", f"{subject.xml_error}; its content could not be checked"
    declared = _DECLARATION.match(subject.members.get(XML, b"").removeprefix(b"\xef\xbb\xbf"))
    if declared and declared[1].lower() not in (b"utf-8", b"utf8"):
        yield "xml-encoding", f"it declares {declared[1].decode('latin-1')}"


# ---- Documents, sources, reference results --------------------------------------------------------------------------


def contents(subject: Subject, fmu: Description) -> Faults:
    """Yield faults of sources, documentation, licences, icon, reference results and the name of the file."""
    members = subject.members
    yield "source-files", _missing_sources(subject, fmu.sources.files)
    if not fmu.sources.files:
        yield "sources", "no sources are listed"
    page = members.get("documentation/index.html")
    if page is None or not page.strip():
        yield "documentation", "it is missing" if page is None else "it is empty"
    licences = [name for name in members if name.startswith(("documentation/licenses/", "licenses/"))]
    if not licences:
        yield "license", "it is missing"
    yield "license", some((name for name in licences if not members[name].strip()), "empty: ")
    icon = members.get("terminalsAndIcons/icon.png" if fmu.fmi == 3 else "model.png")
    yield ("icon", "it is missing") if icon is None else ("icon-format", _fault_of_png(icon))
    if not any(name.startswith("extra/") and name.endswith("_ref.csv") for name in members):
        yield "reference-given", "there is no extra/.../*_ref.csv"
    if fmu.identifier and subject.path.stem != fmu.identifier:
        yield "file-name", f"the file is {subject.path.name}, the modelIdentifier {fmu.identifier}"


def _missing_sources(subject: Subject, names: tuple[str, ...]) -> str:
    return some((name for name in names if f"sources/{name}" not in subject.members), "missing in sources/: ")


_PNG = b"\x89PNG\r\n\x1a\n"

#: Maximum number of pixels that are decoded: a file of a few kilobytes can decode to gigabytes of one colour.
_MOST_PIXELS = 2**24


def _fault_of_png(content: bytes) -> str:
    if not content.startswith(_PNG):
        return "it does not start with a PNG signature"
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


def exchange_files(subject: Subject, fmu: Description) -> Faults:
    """Yield faults of the binaries and sources of model exchange."""
    if fmu.model_exchange is not None:
        name = fmu.model_exchange.get("modelIdentifier", "")
        stems: dict[str, set[str]] = {}
        for binary in subject.binaries:
            stems.setdefault(binary.platform, set()).add(PurePosixPath(binary.name).stem)
        missing = sorted(platform for platform, names in stems.items() if name not in names)
        is_name = re.fullmatch(r"[A-Za-z_]\w*", name, flags=re.ASCII)
        what = some(missing, f"there is no binary {name!r} for ") if is_name else f"it is {name!r}"
        yield "exchange-identifier", what
    if fmu.fmi == 2 or fmu.exchange_sources.files != fmu.sources.files:  # FMI 3.0 may have one list for both
        yield "exchange-sources", _missing_sources(subject, fmu.exchange_sources.files)


# ---- Terminals ------------------------------------------------------------------------------------------------------

_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
_FLOWS = ("inflow", "outflow")

#: Flow of a force by its causality: a force that is positive in compression leaves the shock and enters the vehicle.
_FLOW_OF_FORCE = {"output": "outflow", "input": "inflow"}

#: Kind of connection and variable of a member of a terminal.
_Member = tuple[str, Variable]


def terminals(subject: Subject, fmu: Description) -> Faults:
    """Yield faults of terminals: they must be readable, refer to existing variables, and fit their causality."""
    if _PATH not in subject.members:
        yield "terminals", f"{_PATH} is missing"
        return
    try:
        root = ET.fromstring(subject.members[_PATH])
    except (ET.ParseError, ValueError, LookupError) as error:
        yield "terminals-valid", f"{_PATH}: {error}"
        return
    named = (e.get("variableName", "") for e in root.iter("TerminalMemberVariable"))
    yield "terminals-valid", some((name for name in named if name not in fmu.by_name), "unknown variables: ")
    if root.find("Terminals/Terminal") is None:
        yield "terminals-valid", "it contains no Terminal"
    icons = (e.get("iconBaseName", "") for e in root.iter("TerminalGraphicalRepresentation"))
    folder = PurePosixPath(_PATH).parent
    missing = (name for name in icons if name and str(folder / f"{name}.png") not in subject.members)
    yield "terminals-valid", some(missing, "missing icons: ")
    for terminal in root.iter("Terminal"):
        for fault in _contradictions(_members(terminal, fmu.by_name)):
            yield "terminals-consistent", f"terminal {terminal.get('name', '')!r}: {fault}"


def _members(terminal: ET.Element, variables: Mapping[str, Variable]) -> dict[str, _Member]:
    """Return the members with existing variables by their names in the terminal."""
    elements = [(e, e.get("variableName", "")) for e in terminal.iterfind("TerminalMemberVariable")]
    return {
        e.get("memberName", name): (e.get("variableKind", ""), variables[name])
        for e, name in elements
        if name in variables
    }


def _contradictions(members: Mapping[str, _Member]) -> Iterator[str]:
    for kind, variable in members.values():
        if variable.causality in ("local", "independent"):
            yield f"{variable.name} is {variable.causality}; such variables cannot be connected"
        elif kind in _FLOWS and variable.causality not in ("input", "output"):
            yield f"{variable.name} is an {kind} and a {variable.causality}; flows are inputs or outputs"
    if {"velocity", "force"} <= members.keys():
        (_, velocity), (_, force) = members["velocity"], members["force"]
        if (velocity.unit, force.unit) == ("m/s", "N"):
            yield from _port(members, *members["force"])


def _port(members: Mapping[str, _Member], kind: str, force: Variable) -> Iterator[str]:
    """Yield contradictions at a port: motions and force must have opposite causality (docs/reference/ports.md)."""
    causality, flow = force.causality, _FLOW_OF_FORCE.get(force.causality)
    if flow and kind in _FLOWS and kind != flow:
        yield f"{force.name} is an {causality}, and so an {flow}, not an {kind}"
    for motion_kind, motion in (members[name] for name in ("velocity", "displacement") if name in members):
        if motion.causality == causality:
            yield f"{motion.name} and {force.name} are both {causality}s; one must be the opposite"
        if motion_kind in _FLOWS:
            yield f"{motion.name} is equal on both sides, and so a signal, not an {motion_kind}"
