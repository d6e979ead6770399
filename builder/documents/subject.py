"""The subject of an FMU's documents, and how much of it they disclose."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from builder.interface import Interface
from eightpost.shock import Shock
from eightpost.vehicle import Vehicle

#: Prefix of the variables that disclose the shape of a curve.
SECRET = "curve."


@dataclass(frozen=True)
class Subject:
    """One FMU to document: its C name, a one-line description, its variables, and its shock or vehicle."""

    identifier: str
    text: str
    interface: Interface
    source: Shock | Vehicle


class Disclosure(Enum):
    """Amount of information in an archive about its source."""

    FULL = "full"
    """Everything: sources, pictures, coefficients, conditions, digests of the source files."""

    CONFIDENTIAL = "confidential"
    """Only what is needed to use the FMU: no sources, curve pictures, coefficients, or names of source files."""
