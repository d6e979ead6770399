"""Recipes: rig tests to an identified vehicle. Each file of this folder is one; its `RECIPE` goes by the file's name.

A recipe is a frozen dataclass of its settings with `identify`; `common_poles.py` is "common-poles" everywhere else.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.signals import TimeSeries


class VehicleRecipe(Protocol):
    """A way from rig tests to a vehicle."""

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle.

        Args:
            tests: Records of rig tests at one rate, with the experiment's channels; any shocks in any of them, the
                baseline first.
            experiment: What is input, shock force and output.

        Raises:
            InputError: Tests and experiment do not fit together, or do not tell the inputs apart.
        """
        ...


def recipe_names() -> tuple[str, ...]:
    """Return the names of all recipes."""
    modules = pkgutil.iter_modules([str(Path(__file__).parent)])
    return tuple(sorted(module.name.replace("_", "-") for module in modules))


def recipe(name: str) -> VehicleRecipe:
    """Return the recipe of a name, with its default settings.

    Raises:
        ParameterError: There is none of that name.
    """
    if name not in recipe_names():
        raise ParameterError(f"there is no recipe {name!r}; there are {', '.join(recipe_names())}")
    found: VehicleRecipe = import_module(f"{__name__}.{name.replace('-', '_')}").RECIPE
    return found
