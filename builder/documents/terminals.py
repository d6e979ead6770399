"""Generation of terminalsAndIcons.xml, which groups variables into ports, so that tools can connect whole ports.

The format is that of FMI 3.0, which FMI 2.0.4 adopts unchanged; `fmiVersion` is the version of the format.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from builder.fmu.interface import Interface, Variable
from eightpost.corners import CORNERS

#: Kind of the terminals on both sides of a connection; a leading underscore marks a kind that is not standardized.
KIND = "_eightpost.translational_port"

#: At a connection the sum of all inflows equals the sum of all outflows. The shock's force (positive in compression)
#: acts on the vehicle: it leaves the shock and enters the vehicle. Hence `force` is an outflow if it is an output, and
#: an inflow if it is an input. If both were inflows, an importer that sums flows to zero would change the sign. With
#: this rule, the forces of several elements at one port (shock and bump stop) are added.
_FLOW = {"output": "outflow", "input": "inflow"}


@dataclass(frozen=True)
class Terminal:
    """One port: its name, and its variables by member name, which is the same at every port."""

    name: str
    members: dict[str, Variable]


def terminals(interface: Interface) -> tuple[Terminal, ...]:
    """Return the ports of a shock or a vehicle: the prefixes that have a velocity and a force."""
    variables = {v.name: v for v in interface.variables}
    return tuple(_terminals(variables))


def _terminals(variables: dict[str, Variable]) -> Iterator[Terminal]:
    for prefix in ("", *(f"{corner}." for corner in CORNERS)):
        members = {name: variables.get(f"{prefix}{name}") for name in ("velocity", "displacement", "force")}
        found = {name: variable for name, variable in members.items() if variable is not None}
        if "velocity" in found and "force" in found:
            yield Terminal(prefix.rstrip(".") or "port", found)


def terminals_and_icons(interface: Interface) -> bytes:
    """Return terminalsAndIcons.xml.

    Velocity and displacement are equal on both sides (`signal`); the force is a flow. The rule `plug` connects all
    members or no member: without the displacement, a shock would lose its gas spring.

    There is no GraphicalRepresentation. It would have to be the first element, and fmutool (2.0) only looks for
    terminals in the first element. It could only state the area of icon.png, which is the whole square by default.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    parent = ET.SubElement(root, "Terminals")
    for terminal in terminals(interface):
        attributes = {
            "name": terminal.name,
            "matchingRule": "plug",
            "terminalKind": KIND,
            "description": "Velocity, displacement and force of a shock, all positive in compression",
        }
        element = ET.SubElement(parent, "Terminal", attributes)
        for member, variable in terminal.members.items():
            kind = _FLOW[variable.causality] if member == "force" else "signal"
            names = {"variableName": variable.name, "memberName": member, "variableKind": kind}
            ET.SubElement(element, "TerminalMemberVariable", names)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
