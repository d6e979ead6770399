"""What else is in the archive: sources, documents, icon, terminals, reference results."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import PurePosixPath

from builder.check.catalogue import archive as rules
from builder.check.catalogue import description as described
from builder.check.rules import Finding, listed
from builder.check.subject import Subject

_TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_PNG = b"\x89PNG\r\n\x1a\n"


def sources(subject: Subject) -> Iterator[Finding]:
    """Sources that are listed are there."""
    listed_files = subject.description.source_files if subject.description else ()
    missing = [name for name in listed_files if f"sources/{name}" not in subject.members]
    if missing:
        yield rules.SOURCE_FILES.finding(f"missing in sources/: {listed(missing)}")
    if not listed_files:
        yield rules.SOURCES.finding("none are listed")


def documents(subject: Subject) -> Iterator[Finding]:
    """Documentation and licence are there."""
    if "documentation/index.html" not in subject.members:
        yield rules.DOCUMENTATION.finding("it is missing")
    if not any(name.startswith(("documentation/licenses/", "licenses/")) for name in subject.members):
        yield rules.LICENSE.finding("there is none")


def icon(subject: Subject) -> Iterator[Finding]:
    """model.png is there and is one."""
    content = subject.members.get("model.png")
    if content is None:
        yield rules.ICON.finding("it is missing")
    elif not content.startswith(_PNG):
        yield rules.ICON_FORMAT.finding("it does not begin like a PNG")


def terminals(subject: Subject) -> Iterator[Finding]:
    """Terminals name variables that are there."""
    content = subject.members.get(_TERMINALS)
    if content is None:
        yield rules.TERMINALS.finding("there are none")
        return
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        yield rules.TERMINALS_VALID.finding(f"{_TERMINALS}: {error}")
        return
    yield from _terminals(subject, root)


def _terminals(subject: Subject, root: ET.Element) -> Iterator[Finding]:
    variables = subject.description.by_name if subject.description else {}
    named = [e.get("variableName", "") for e in root.iter("TerminalMemberVariable")]
    if unknown := [name for name in named if name not in variables]:
        yield rules.TERMINALS_VALID.finding(f"no such variable: {listed(unknown)}")
    if root.find("Terminals/Terminal") is None:
        yield rules.TERMINALS_VALID.finding("there is no Terminal in it")
    folder = PurePosixPath(_TERMINALS).parent
    icons = [e.get("iconBaseName", "") for e in root.iter("TerminalGraphicalRepresentation")]
    missing = [name for name in icons if name and str(folder / f"{name}.png") not in subject.members]
    if missing:
        yield rules.TERMINALS_VALID.finding(f"no such icon: {listed(missing)}")


def reference(subject: Subject) -> Iterator[Finding]:
    """Reference results are there."""
    if not any(name.startswith("extra/") and name.endswith("_ref.csv") for name in subject.members):
        yield rules.REFERENCE_GIVEN.finding("there is no extra/.../*_ref.csv")


def file_name(subject: Subject) -> Iterator[Finding]:
    """The file is named after the modelIdentifier."""
    identifier = subject.description.identifier if subject.description else ""
    if identifier and subject.path.stem != identifier:
        yield described.FILE_NAME.finding(f"the file is {subject.path.name}, the modelIdentifier {identifier}")


RULES = (sources, documents, icon, terminals, reference, file_name)
