"""terminalsAndIcons.xml: which variables make up a port, so that tools connect ports and not single variables.

The file is that of FMI 3.0, which FMI 2.0.4 takes over as it is; its `fmiVersion` is the version of that file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from builder.interface import CORNERS, Interface, Variable

#: Both ends of a bond are of this kind; the leading underscore marks a kind that is not a standard's.
KIND = "_eightpost.translational_port"

#: A flow is what one component gives and the other takes. At a connection all inflows together equal all outflows.
#: The shock's force (positive in compression) acts on the vehicle: it leaves the shock and enters the vehicle. Hence
#: `force` is an outflow where it is an output and an inflow where it is an input; with both called inflow, an importer
#: that sums flows to zero would turn the sign. Several elements at one port (shock and bump stop) add up by this rule.
_FLOW = {"output": "outflow", "input": "inflow"}


@dataclass(frozen=True)
class Terminal:
    """One port: its name, and the variables that it holds by what they are called at any port."""

    name: str
    members: dict[str, Variable]


def terminals(interface: Interface) -> tuple[Terminal, ...]:
    """Return the ports of a shock or a vehicle: those prefixes with a velocity and a force."""
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

    Velocity and displacement are the same on both sides (`signal`), the force flows. The rule `plug` connects all
    members or none: a shock's gas spring would be lost without the displacement.

    There is no GraphicalRepresentation. It would have to be the first element, and fmutool (2.0) looks for the
    terminals in the first element only. What it could say, where icon.png lies, is the whole square by default.
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
