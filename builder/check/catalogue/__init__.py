"""All rules of `check`.

A rule of level *error* is a rule of the FMI standard, version 2.0.4. A rule of level *drop-in* covers what the standard
allows but some tools cannot import. A *hint* makes an FMU easier to use.
"""

from __future__ import annotations

from builder.check.catalogue import archive, behaviour, description
from builder.check.rules import Rule

CATALOGUE: tuple[Rule, ...] = tuple(
    value for module in (archive, description, behaviour) for value in vars(module).values() if isinstance(value, Rule)
)
