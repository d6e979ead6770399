"""Every rule that `check` knows.

A rule of level *error* is one of the FMI standard, version 2.0.4; *drop-in* is what breaks imports into tools although
the standard does not forbid it; a *hint* makes an FMU nicer to use.
"""

from __future__ import annotations

from builder.check.catalogue import archive, behaviour, description
from builder.check.rules import Rule

CATALOGUE: tuple[Rule, ...] = tuple(
    value for module in (archive, description, behaviour) for value in vars(module).values() if isinstance(value, Rule)
)
