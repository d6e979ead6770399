"""What an FMU's documents are about, and how much of it they may tell."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from builder.interface import Interface
from eightpost.shock import Shock
from eightpost.vehicle import Vehicle

#: Variables that give the shape of a curve away.
SECRET = "curve."


@dataclass(frozen=True)
class Subject:
    """One FMU to document: its C name, one line of text, its variables, and what it was made from."""

    identifier: str
    text: str
    interface: Interface
    source: Shock | Vehicle


class Disclosure(Enum):
    """How much an archive tells about what it was made from."""

    FULL = "full"
    """Everything: sources, pictures, coefficients, conditions, digests of the source files."""

    CONFIDENTIAL = "confidential"
    """What is needed to use it: no sources, curve pictures, coefficients, or names of source files."""
