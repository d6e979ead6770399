"""Rules for terminalsAndIcons/: terminals refer to existing variables and match their causality."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from builder.check.catalogue import archive as rules
from builder.check.description import Variable
from builder.check.rules import Finding, listed
from builder.check.subject import Subject

_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
_FLOWS = ("inflow", "outflow")

#: Flow of a force by its causality: a force that is positive in compression leaves the shock and enters the vehicle.
_FLOW_OF_FORCE = {"output": "outflow", "input": "inflow"}


@dataclass(frozen=True)
class _Member:
    """A member of a terminal: its kind of connection, and its variable."""

    kind: str
    variable: Variable


def terminals(subject: Subject) -> Iterator[Finding]:
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
    """Yield contradictions at a port: motions and force must have opposite causality (docs/ports.md)."""
    causality, flow = force.variable.causality, _FLOW_OF_FORCE.get(force.variable.causality)
    if flow and force.kind in _FLOWS and force.kind != flow:
        yield f"{force.variable.name} is an {causality}, and so an {flow}, not an {force.kind}"
    motions = [member for member in (velocity, members.get("displacement")) if member is not None]
    for motion in motions:
        if motion.variable.causality == causality:
            yield f"{motion.variable.name} and {force.variable.name} are both {causality}s; one must be the opposite"
        if motion.kind in _FLOWS:
            yield f"{motion.variable.name} is equal on both sides, and so a signal, not an {motion.kind}"


RULES = (terminals,)
