"""terminalsAndIcons/: terminals name variables that are there, and fit what those are."""

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

#: The flow that a force is, by its causality: positive in compression, it leaves the shock and enters the vehicle.
_FLOW_OF_FORCE = {"output": "outflow", "input": "inflow"}


@dataclass(frozen=True)
class _Member:
    """A member of a terminal: how it is to be connected, and its variable."""

    kind: str
    variable: Variable


def terminals(subject: Subject) -> Iterator[Finding]:
    """Terminals can be read and name what is there."""
    content = subject.members.get(_PATH)
    if content is None:
        yield rules.TERMINALS.finding("there are none")
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
        yield rules.TERMINALS_VALID.finding(f"no such variable: {listed(unknown)}")
    if root.find("Terminals/Terminal") is None:
        yield rules.TERMINALS_VALID.finding("there is no Terminal in it")
    folder = PurePosixPath(_PATH).parent
    icons = [e.get("iconBaseName", "") for e in root.iter("TerminalGraphicalRepresentation")]
    missing = [name for name in icons if name and str(folder / f"{name}.png") not in subject.members]
    if missing:
        yield rules.TERMINALS_VALID.finding(f"no such icon: {listed(missing)}")


def _members(terminal: ET.Element, variables: Mapping[str, Variable]) -> dict[str, _Member]:
    """Return the members whose variables are there, by their names in the terminal."""
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
            yield f"{member.variable.name} is {causality}, and no such variable may be connected"
        elif member.kind in _FLOWS and causality not in ("input", "output"):
            yield f"{member.variable.name} is an {member.kind} and a {causality}; flows are inputs or outputs"
    velocity, force = members.get("velocity"), members.get("force")
    if velocity and force and (velocity.variable.unit, force.variable.unit) == ("m/s", "N"):
        yield from _port(members, velocity, force)


def _port(members: Mapping[str, _Member], velocity: _Member, force: _Member) -> Iterator[str]:
    """A shock takes the motion and gives the force, a vehicle the other way round (docs/ports.md)."""
    given, wanted = force.variable.causality, _FLOW_OF_FORCE.get(force.variable.causality)
    if wanted and force.kind in _FLOWS and force.kind != wanted:
        yield f"{force.variable.name} is an {given}, and so an {wanted}, not an {force.kind}"
    motions = [member for member in (velocity, members.get("displacement")) if member is not None]
    for motion in motions:
        if motion.variable.causality == given:
            yield f"{motion.variable.name} and {force.variable.name} are both {given}s; one is what the other end gives"
        if motion.kind in _FLOWS:
            yield f"{motion.variable.name} is the same on both ends, and so a signal, not an {motion.kind}"


RULES = (terminals,)
