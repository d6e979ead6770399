"""Methods of the identification benchmark: each file of this folder has METHODS, recipes by the name in the table.

A method is any recipe of `eightpost.ident.vehicle.recipes`. Friction at the ports that a fit has found is simulated
where the file has a function `friction(fit)` that returns it by port.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from eightpost.ident.vehicle.many_setups import Rubbing
from eightpost.ident.vehicle.recipes import VehicleRecipe
from eightpost.ident.vehicle.vehicle_fit import VehicleFit


class Method(NamedTuple):
    """How a vehicle is identified and what friction it is simulated with."""

    recipe: VehicleRecipe
    friction: Callable[[VehicleFit], Mapping[str, Rubbing]]


def methods() -> dict[str, Method]:
    """Return every method by name."""
    found: dict[str, Method] = {}
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        content = import_module(f"{__name__}.{module.name}")
        friction = getattr(content, "friction", _no_friction)
        found |= {name: Method(recipe, friction) for name, recipe in content.METHODS.items()}
    return found


def _no_friction(_: VehicleFit) -> Mapping[str, Rubbing]:
    return {}
