"""Methods of the identification benchmark: each file of this folder defines METHODS, recipes by name in the table.

A method is any recipe of `eightpost.ident.vehicle.recipes`; friction that it estimates at the ports is part of the
vehicle.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from pathlib import Path

from eightpost.ident.vehicle.recipes import VehicleRecipe


def methods() -> dict[str, VehicleRecipe]:
    """Return every method by name."""
    found: dict[str, VehicleRecipe] = {}
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        found |= import_module(f"{__name__}.{module.name}").METHODS
    return found
